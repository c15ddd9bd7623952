"""What the cut of a picture draws."""

from __future__ import annotations

from collections import Counter

from tests.render.rendering import settings_of
from usdsplat.render.lod.nodes import nodes_of
from usdsplat.render.sampling import Sample


def _drawn(scene, view, **settings):
    nodes = nodes_of(scene, lambda _: (scene, view), settings_of(**settings), (Sample(),))
    return nodes, nodes.layout(scene, (0.0, 0.0))


def drawn_counts(scene, view, **settings):
    """Number of splats that are drawn, by prim."""
    _, layout = _drawn(scene, view, **settings)
    counts = Counter()
    for group in layout.groups:
        name = "/tree" if group.field.is_node else "/a"
        weights = layout.weights
        shown = group.instances if weights is None else (weights[group.appearances] > 0).sum()
        counts[name] += len(group.cloud) * int(shown)
    assert layout.splats == sum(counts.values())
    return dict(+counts)


def drawn_nodes(scene, view, **settings):
    """The nodes of the tree that are drawn."""
    nodes, _ = _drawn(scene, view, **settings)
    drawn = nodes.drawn(scene)
    return {int(path.split(":")[1]) for path, field, _ in drawn if field.is_node}
