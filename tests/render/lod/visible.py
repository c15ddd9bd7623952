"""Which nodes have visible splats, by projecting them."""

from __future__ import annotations

import numpy as np

from tests.render.lod.trees import made
from tests.render.rendering import lens, random_transform, settings_of, view_of
from usdsplat.kernels.devices import open_device
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lod.measure import NodeMeasure
from usdsplat.render.lod.placing import Placing
from usdsplat.render.projector import Projector
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.specs import FieldSpec, InstanceSpec


def visible_nodes(seed, model):
    """The nodes of a tree with splats that are projected into a random window, and those
    that the measure keeps."""
    rng = np.random.default_rng(seed)
    tree = made(seed, n=120, leaf=8)
    matrix = random_transform(seed)
    matrix[:3, 3] += rng.normal(0, 2.5, 3)
    x0, y0 = rng.integers(-20, 120, 2).tolist()
    window = x0, y0, x0 + int(rng.integers(1, 70)), y0 + int(rng.integers(1, 70))
    eye = lens("orthographic" if model == "orthographic" else "perspective")
    screen = Screen.of(view_of(eye, window))
    mode = "tangential" if model == "tangential" else "perspective"
    scene = RenderScene()
    leaves = tree.leaves()
    scene.set_field("/f", FieldSpec(cloud=leaves, projection_mode=mode))
    scene.set_instances("/f", (InstanceSpec(path="/f", transform=tuple(matrix.ravel())),))
    device = open_device()
    layout = scene.draw_list()
    projector = Projector(
        device, FrameBuffers(device.resident), layout, screen, settings_of(), "srgb_rec709_scene"
    )
    projector.lay_out()
    projector.project()
    projector.shade()
    splats = projector.sort((), labels=False)
    rows = set(np.asarray(splats.sources)[np.asarray(splats.order)].tolist())
    leaf = np.flatnonzero(tree.table.child_count == 0)
    ends = np.cumsum(tree.table.proxies[leaf])
    parents = tree.table.parents()
    expected = set()
    for row in rows:
        at = int(leaf[np.searchsorted(ends, row, side="right")])
        while at >= 0:
            expected.add(at)
            at = int(parents[at])
    nodes = np.arange(len(tree.table))
    measure = NodeMeasure(tree.table, screen, Placing(matrix[None]), mode == "tangential")
    seen = measure.of(np.zeros(len(nodes), int), nodes).in_window
    return expected, set(np.flatnonzero(seen).tolist())
