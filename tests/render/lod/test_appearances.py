"""Tests of the layout of nodes: its order, when it is kept, and its parts for a GPU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.render.lod.trees import made
from tests.render.rendering import lens, random_cloud, random_transform, settings_of, view_of
from usdsplat.kernels.cuda.frame.project import PART
from usdsplat.kernels.fading import WHOLE
from usdsplat.render.cuda_nodes import NodeRun, planned
from usdsplat.render.lod.nodes import nodes_of
from usdsplat.render.sampling import Sample
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import FieldSpec, InstanceSpec


def placed(path, *indices):
    return tuple(
        InstanceSpec(path=path, index=i, transform=tuple(random_transform(i).ravel()))
        for i in indices
    )


def scene_of(tree):
    """A tree in three instances, and a field before and after it."""
    scene = RenderScene()
    scene.set_tree("/tree", tree.spec())
    scene.set_instances("/tree", placed("/tree", 0, 1, 2))
    for seed, path in enumerate(("/a", "/z")):
        scene.set_field(path, FieldSpec(cloud=random_cloud(seed, 10)))
        scene.set_instances(path, placed(path, 4, 3))
    return scene


def nodes_in(scene, view, **settings):
    return nodes_of(scene, lambda _: (scene, view), settings_of(**settings), (Sample(),))


def test_captures_are_in_the_order_of_paths_before_coarse_levels():
    """Oracle: the paths and indices, sorted, and the nodes of the cut."""
    scene = scene_of(made(1, n=200, strays=4, error=0.05))
    nodes = nodes_in(scene, view_of(lens()), lod_error=20.0)
    names = [(each.path, each.index, name) for name, _, each in nodes.drawn(scene)]
    inner = [name for name in names if name[2].endswith(":proxies")]
    captured = names[: len(names) - len(inner)]
    assert inner == names[len(captured) :]
    assert captured[:2] == [("/a", 3, "/a"), ("/a", 4, "/a")]
    assert captured[-2:] == [("/z", 3, "/z"), ("/z", 4, "/z")]
    for some in (inner, captured[2:-2]):
        assert len(some) > 3
        order = [(int(name.split(":")[1]), index) for _, index, name in some]
        assert order == sorted(order)


def test_a_layout_is_kept_while_the_cut_is_the_same():
    """Oracle: identity, and the drawn nodes."""
    scene, view = scene_of(made(1, n=200, error=0.05)), view_of(lens())
    first = nodes_in(scene, view, lod_error=20.0)
    layout = first.layout(scene, (0.0, 0.0))
    moved = np.array(view.camera.world_to_camera).reshape(4, 4)
    moved[0, 3] += 1e-4
    near = replace(view, camera=replace(view.camera, world_to_camera=tuple(moved.ravel())))
    second = nodes_in(scene, near, lod_error=20.0)
    assert second.layout(scene, (0.0, 0.0)).placed is layout.placed
    assert [each[0] for each in second.drawn(scene)] == [each[0] for each in first.drawn(scene)]
    assert (
        nodes_in(scene, view, lod_error=5.0).layout(scene, (0.0, 0.0)).placed is not layout.placed
    )
    scene.set_visible("/z", visible=False)
    fewer = nodes_in(scene, view, lod_error=20.0).layout(scene, (0.0, 0.0))
    assert len(fewer.placed) == len(layout.placed) - 2


def test_a_gpu_draws_the_parts_of_each_appearance_in_order():
    """Oracle: the appearances and their splats, one by one."""
    scene = scene_of(made(1, n=2000, leaf=600, error=0.05))
    nodes = nodes_in(scene, view_of(lens()), lod_error=50.0, lod_samples=2)
    layout = nodes.layout(scene, (0.0, 0.0))
    weights = np.float32([1, 0, 0.25])[np.arange(len(layout.placed)) % 3]
    given = {}

    def pages_of(coefficients, clouds):
        assert {each.sh.shape[1] for each in clouds} == {coefficients}
        for each in clouds:
            first = 7 * len(given)
            given[id(each)] = np.arange(-(-len(each) // PART), dtype=np.int32)[::-1] + first
        return [given[id(each)] for each in clouds]

    plan = planned(layout, pages_of)
    assert plan[:1] == [0]
    drawn = nodes.drawn(scene)
    for run in plan:
        if not isinstance(run, NodeRun):
            continue
        expected = []
        first = layout.groups[run.head].first
        is_inner = layout.groups[run.head].field.is_inner
        for at in range(first, len(drawn)):
            _, field, instance = drawn[at]
            if not field.is_node or field.is_inner != is_inner:
                break
            for number, page in enumerate(given[id(field.spec.cloud)].tolist()):
                count = min(PART, len(field.spec.cloud) - PART * number)
                shown = 0 if weights[at] == 0 else count
                whole = int(WHOLE * weights[at])
                expected.append((PART * page, shown, instance.transform, whole))
        table = run.drawn(weights)
        found = [
            (a, n, tuple(run.placements.transforms[k].ravel()), whole)
            for a, n, k, whole in table.tolist()
        ]
        assert found[: len(expected)] == expected
        assert not table[len(expected) :].any()
        assert (run.drawn(None)[: len(expected), 1] > 0).all()
        assert (run.drawn(None)[: len(expected), 3] == WHOLE).all()
    assert sum(isinstance(run, NodeRun) for run in plan) == 2
    again = planned(layout, pages_of, [run for run in plan if isinstance(run, NodeRun)])
    assert [len(run.table) for run in again if isinstance(run, NodeRun)] == [
        len(run.table) for run in plan if isinstance(run, NodeRun)
    ]
