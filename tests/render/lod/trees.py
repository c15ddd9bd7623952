"""Small trees of random splats, for tests of levels of detail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.render.rendering import random_cloud
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edit import take
from usdsplat.core.extent import extent
from usdsplat.core.node_table import NodeTable, check_nodes
from usdsplat.render.lod.tree import TreeSpec

OF_SURFACES = {"Neye", "confidence", "occlusion"}
"""AOVs of the surfaces of splats, which only fields have."""


def concatenated(clouds):
    """One cloud of several of the same degree."""
    names = ("positions", "scales", "rotations", "opacities", "sh")
    return SplatCloud(**{k: np.concatenate([getattr(c, k) for c in clouds]) for k in names})


class Made:
    """A tree made of a cloud by halving its longest axis: inner nodes hold every second splat.

    Each node has a chunk of its own. The first `strays` splats are residents of the root.
    """

    def __init__(self, cloud, *, leaf=30, error=0.02, strays=0):
        self.reads = []
        nodes = [take(cloud, np.arange(strays, len(cloud)))]
        children, at = [], 0
        while at < len(nodes):
            here = nodes[at]
            if len(here) > leaf:
                axis = int(np.argmax(np.ptp(here.positions, axis=0)))
                order = np.argsort(here.positions[:, axis], kind="stable")
                half = len(order) // 2
                children.append((len(nodes), 2))
                nodes += [take(here, np.sort(part)) for part in (order[:half], order[half:])]
            else:
                children.append((0, 0))
            at += 1
        n = len(nodes)
        first, count = (np.array(each, np.int32) for each in zip(*children, strict=True))
        low, high = np.empty((n, 3)), np.empty((n, 3))
        errors = np.zeros(n)
        self.strays = take(cloud, np.arange(strays))
        self.clouds = []
        for node in reversed(range(n)):
            low[node], high[node] = extent(nodes[node], slack=1e-3)
            below = range(first[node], first[node] + count[node])
            for child in below:
                low[node] = np.minimum(low[node], low[child])
                high[node] = np.maximum(high[node], high[child])
                errors[node] = max(errors[node], error, 1.3 * errors[child])
        if strays:
            box = extent(cloud, slack=1e-3)
            low[0], high[0] = np.minimum(low[0], box[0]), np.maximum(high[0], box[1])
        for node in range(n):
            kept = take(nodes[node], np.arange(0, len(nodes[node]), 2 if count[node] else 1))
            self.clouds.append(concatenated([kept, self.strays]) if node == 0 else kept)
        residents = np.zeros(n, np.int64)
        residents[0] = strays
        self.table = NodeTable(
            low=low.astype(np.float32),
            high=high.astype(np.float32),
            errors=errors.astype(np.float32),
            first_child=first,
            child_count=count,
            chunk=np.arange(n, dtype=np.int32),
            first_row=np.zeros(n, np.int64),
            proxies=np.array([len(each) for each in self.clouds]) - residents,
            residents=residents,
        )
        check_nodes(self.table, "/tree", chunks=n)

    def load(self, chunk, first, count):
        """Rows of a chunk; each read is recorded."""
        self.reads.append((chunk, first, count))
        return take(self.clouds[chunk], np.arange(first, first + count))

    def spec(self, **options):
        chunks = tuple((id(self), i) for i in range(len(self.clouds)))
        given = {"chunks": chunks, "load": self.load, "degree": 3} | options
        return TreeSpec(table=self.table, **given)

    def leaves(self):
        """The splats of a cut of leaves, in the order in which they are drawn."""
        leaf = np.flatnonzero(self.table.child_count == 0)
        root = [self.strays] if len(self.strays) else []
        return concatenated([*root, *(self.clouds[node] for node in leaf)])


def made(seed=1, n=400, degree=3, **options):
    """A tree of random splats of moderate size."""
    cloud = random_cloud(seed, n, degree)
    return Made(replace(cloud, scales=0.4 * cloud.scales), **options)
