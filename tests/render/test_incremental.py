"""Tests that reusing results of the last picture does not change pictures: they equal those of a
new renderer, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.rendering import lens, picture, random_cloud, settings_of, view_of
from usdsplat.kernels.devices import open_device
from usdsplat.render import spatial_order
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import CropSpec, FieldSpec, InstanceSpec

LARGE = 20_000
AOVS = ("color", "depth", "elementId", "Neye", "cryptoObject")
IDENTITY = tuple(np.eye(4).ravel())


def moved(x, y=0.0):
    matrix = np.eye(4)
    matrix[:2, 3] = x, y
    return tuple(matrix.ravel())


def large_cloud(seed):
    """Splats of which many are at the same depth: their order is a matter of ties."""
    cloud = random_cloud(seed, n=LARGE, degree=1)
    positions = cloud.positions.copy()
    positions[:, 2] = np.round(positions[:, 2] * 8) / 8
    return replace(cloud, positions=positions, scales=cloud.scales * np.float32(0.2))


def scene_of_both():
    """A large field twice and a small one."""
    scene = RenderScene()
    scene.set_field("/large", FieldSpec(cloud=large_cloud(1)))
    scene.set_instances(
        "/large",
        (InstanceSpec(path="/large"), InstanceSpec(path="/large", index=1, transform=moved(0.7))),
    )
    scene.set_field("/small", FieldSpec(cloud=random_cloud(2)))
    scene.set_instances("/small", (InstanceSpec(path="/small"),))
    return scene


def edited(scene, path, **arrays):
    """Replace arrays of a field's cloud; the others are equal ones, but copies."""
    cloud = next(f.spec for p, f, _ in scene.drawn() if p == path).cloud
    copies = {name: getattr(cloud, name).copy() for name in (*layout_arrays(), "sh")}
    scene.set_field(path, FieldSpec(cloud=replace(cloud, **(copies | arrays))))


def layout_arrays():
    return ("positions", "rotations", "scales", "opacities")


def colors(scene):
    edited(scene, "/large", sh=large_cloud(1).sh[::-1].copy())


def opacities(scene):
    edited(scene, "/small", opacities=random_cloud(5).opacities)


def positions(scene):
    edited(scene, "/large", positions=large_cloud(4).positions)


def count(scene):
    scene.set_field("/small", FieldSpec(cloud=random_cloud(7, n=90)))


def placed(scene):
    scene.set_instances("/small", (InstanceSpec(path="/small", transform=moved(0.2, 0.1)),))


def more(scene):
    scene.set_instances(
        "/large", tuple(InstanceSpec(path="/large", index=i, transform=moved(i)) for i in range(3))
    )


def hidden(scene):
    scene.set_visible("/large", False)


def cropped(scene):
    crop = CropSpec(shape="sphere", world_to_shape=IDENTITY, keeps=True)
    scene.set_crops("/large", (crop,))


def graded(scene):
    spec = next(f.spec for p, f, _ in scene.drawn() if p == "/large")
    scene.set_field("/large", replace(spec, grade=(0.5, 0, 0, 0, 1, 0, 0, 0, 1)))


def antialiased(scene):
    spec = next(f.spec for p, f, _ in scene.drawn() if p == "/small")
    scene.set_field("/small", replace(spec, rasterize_mode="antialiased"))


def added(scene):
    scene.set_field("/another", FieldSpec(cloud=random_cloud(9)))
    scene.set_instances("/another", (InstanceSpec(path="/another"),))


def removed(scene):
    scene.remove("/small")


EDITS = (
    colors, opacities, positions, count, placed, more, hidden, cropped, graded, antialiased, added,
    removed,
)  # fmt: skip


def drawn(renderer, scene, view, aovs=AOVS, **settings):
    bands = list(renderer.render(scene, view, settings_of(**settings), aovs))
    assert len(bands) == 1
    return {name: array.copy() for name, array in bands[0].arrays.items()}


def assert_equal(a, b):
    for name, array in a.items():
        np.testing.assert_array_equal(array, b[name], err_msg=name)


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: edit.__name__)
def test_an_edit_shows_as_if_it_had_always_been(edit):
    """Oracle: a new scene and a new renderer, to which nothing happened but the same edit."""
    view = view_of(lens())
    renderer, scene = Renderer(open_device()), scene_of_both()
    for _ in range(3):
        drawn(renderer, scene, view, ("color",))
    edit(scene)
    fresh = scene_of_both()
    edit(fresh)
    expected = picture(fresh, view, aovs=AOVS)
    assert_equal(expected, drawn(renderer, scene, view))
    assert_equal(expected, drawn(renderer, scene, view))


def test_views_and_settings_take_turns():
    """Oracle: each by a renderer of its own."""
    eye = lens()
    other = replace(eye, world_to_camera=eye.world_to_camera @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    looks = [
        (view_of(eye), {}),
        (view_of(eye), {"sh_degree": 0}),
        (view_of(eye), {"display_mode": "points"}),
        (view_of(eye), {"display_mode": "ellipses"}),
        (view_of(eye), {"sorting": "cameraDistance"}),
        (view_of(eye), {"splat_budget": 9000}),
        (view_of(eye, (20, 30, 90, 100)), {}),
        (view_of(other), {}),
        (replace(view_of(eye), matte=(("/small", True),)), {}),
        (view_of(lens("orthographic")), {}),
    ]
    scene, renderer = scene_of_both(), Renderer(open_device())
    expected = [picture(scene_of_both(), view, aovs=AOVS, **some) for view, some in looks]
    for k in np.random.default_rng(3).permutation(np.repeat(np.arange(len(looks)), 3)):
        view, some = looks[k]
        assert_equal(expected[k], drawn(renderer, scene, view, **some))


def test_a_static_view_projects_nothing_again(monkeypatch):
    """Oracle: the launches of a renderer, counted: only what another AOV or colour needs."""
    device, names = open_device("cpu"), []
    run = device.run
    monkeypatch.setattr(
        device, "run", lambda kernel, *args: names.append(kernel.__name__) or run(kernel, *args)
    )
    renderer, scene, view = Renderer(device), scene_of_both(), view_of(lens())
    drawn(renderer, scene, view, ("color",))
    assert {"project", "radiance", "depth_order", "gather", "tile_lists"} <= set(names)
    names.clear()
    drawn(renderer, scene, view, ("color", "depth"))
    assert not {"project", "radiance", "depth_order", "gather", "tile_lists"} & set(names)
    names.clear()
    colors(scene)
    drawn(renderer, scene, view, ("color",))
    assert names.count("radiance") == 1 and "gather" in names
    assert not {"project", "depth_order", "tile_lists"} & set(names)
    names.clear()
    placed(scene)
    drawn(renderer, scene, view, ("color",))
    assert names.count("project") == names.count("radiance") == names.count("depth_order") == 1


def test_blocks_that_a_view_does_not_see_change_no_picture(monkeypatch):
    """Oracle: the same splats in the order of their rows, with no block left out."""
    eye = lens()
    views = [
        view_of(replace(eye, world_to_camera=eye.world_to_camera @ turn))
        for turn in (np.eye(4), np.diag([-1.0, 1.0, -1.0, 1.0]), np.roll(np.eye(4), 1, axis=0))
    ]
    views += [view_of(lens("orthographic")), view_of(eye, (3, 5, 40, 37))]
    for hint in ("perspective", "tangential"):
        spec = FieldSpec(cloud=large_cloud(3), projection_mode=hint)
        scene, plain = RenderScene(), RenderScene()
        for each in (scene, plain):
            each.set_field("/field", spec)
            each.set_instances("/field", (InstanceSpec(path="/field", transform=moved(0.4)),))
        renderer = Renderer(open_device())
        drawn(renderer, scene, view_of(lens(), (0, 0, 16, 16)))
        closed = []
        for view in views:
            found = drawn(renderer, scene, view)
            with monkeypatch.context() as never:
                never.setattr(spatial_order, "LEAST", LARGE + 1)
                assert_equal(picture(plain, view, aovs=AOVS), found)
            scratch = renderer._idle[0]
            marks = scratch.splats.closed(-(-LARGE // 1024))
            closed.append(renderer._device.fetch(marks).sum())
        assert max(closed) > 0, "or nothing was left out"
