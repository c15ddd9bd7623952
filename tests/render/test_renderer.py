"""Tests of the renderer without USD. Oracle: the float64 reference."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.rendering import (
    SIZE,
    lens,
    picture,
    random_cloud,
    random_transform,
    scene_of,
    view_of,
)
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.kernels import reference
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import AOVS, Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, FieldSpec, Framing, InstanceSpec, View

FOOTPRINT = 0.02
"""Size of a pixel of the photographs: a part of the splats lies nearer, the others farther away."""


@pytest.mark.parametrize("model", ["perspective", "tangential", "orthographic"])
@pytest.mark.parametrize("rasterize_mode", ["classic", "antialiased", "footprint"])
@pytest.mark.parametrize("sorting", ["zDepth", "cameraDistance"])
def test_picture_equals_the_reference(model, rasterize_mode, sorting):
    """Oracle: kernels.reference, float64; sheared and mirrored fields, harmonics to degree 4."""
    parts = [
        (random_cloud(1, degree=4), random_transform(5)),
        (random_cloud(2, degree=0), random_transform(6)),
    ]
    hint = "tangential" if model == "tangential" else "perspective"
    ours = picture(
        scene_of(*parts, projection_mode=hint, footprint=FOOTPRINT), view_of(lens(model)),
        sorting=sorting, rasterize_mode=rasterize_mode,
    )  # fmt: skip
    expected = reference.render(
        parts, lens(model),
        footprint={"classic": np.inf, "antialiased": 0.0, "footprint": FOOTPRINT}[rasterize_mode],
        by_distance=sorting == "cameraDistance",
    )  # fmt: skip
    error = np.abs(ours["color"] - expected.color)
    assert np.quantile(error, 0.999) < 1e-4
    assert error.max() < 0.1, "only the step of the cutoff, on isolated pixels"
    assert -10 * np.log10(np.mean(error**2)) > 80
    element = np.where(
        ours["primId"] >= 0, ours["elementId"] + len(parts[0][0]) * ours["primId"], -1
    )
    assert np.mean(element != expected.element) < 0.002
    same = element == expected.element
    np.testing.assert_allclose(ours["depth"][same], expected.depth[same], rtol=1e-6)


def test_a_lower_degree_drops_the_bands_above():
    """Oracle: the reference of the cloud whose higher bands are cut off."""
    cloud = random_cloud(3, degree=3)
    ours = picture(scene_of((cloud, np.eye(4))), view_of(lens()), sh_degree=1)["color"]
    expected = reference.render([(cloud, np.eye(4))], lens(), degree=1).color
    assert np.quantile(np.abs(ours - expected), 0.999) < 1e-4


def test_any_window_has_the_full_frames_pixels_bit_for_bit():
    """Oracle: the frame with overscan all around, cut to each window."""
    scene = scene_of((random_cloud(4), random_transform(2)), (random_cloud(7), random_transform(9)))
    full = picture(scene, view_of(lens(), (-40, -25, 190, 140)))
    for window in [(0, 0, *SIZE), (17, 33, 90, 71), (-40, 5, 3, 140), (64, 48, 65, 49)]:
        x0, y0, x1, y1 = window
        part = picture(scene, view_of(lens(), window))
        for name in AOVS:
            np.testing.assert_array_equal(
                part[name], full[name][y0 + 25 : y1 + 25, x0 + 40 : x1 + 40], err_msg=name
            )


def test_bands_join_without_a_seam():
    """Oracle: the same picture in one band."""
    scene = scene_of((random_cloud(4), random_transform(2)))
    whole = picture(scene, view_of(lens(), (3, -7, 140, 105)))
    banded = picture(scene, view_of(lens(), (3, -7, 140, 105)), band_pixels=137 * 20)
    for name in AOVS:
        np.testing.assert_array_equal(banded[name], whole[name])


def test_threads_do_not_change_a_bit():
    """Oracle: the picture of one thread."""
    scene = scene_of((random_cloud(8, n=3000), random_transform(2)))
    one, all_of_them = (picture(scene, view_of(lens()), threads=t) for t in (1, None))
    for name in AOVS:
        np.testing.assert_array_equal(one[name], all_of_them[name])


def test_instances_are_copies():
    """Oracle: two fields with equal clouds, each at one of the places."""
    cloud = random_cloud(1)
    places = [random_transform(5), random_transform(6)]
    scene = RenderScene()
    scene.set_field("/proto", FieldSpec(cloud=cloud))
    instances = tuple(
        InstanceSpec(path=f"/field{i}", index=i, transform=tuple(m.ravel()))
        for i, m in enumerate(places)
    )
    scene.set_instances("/proto", instances)
    shared = picture(scene, view_of(lens()))
    apart = picture(scene_of(*((cloud, m) for m in places)), view_of(lens()))
    for name in ("color", "depth", "elementId", "primId"):
        np.testing.assert_array_equal(shared[name], apart[name])
    assert set(np.unique(shared["instanceId"])) == {-1, 0, 1}


def test_equal_depths_are_drawn_in_the_order_of_paths():
    """Oracle: closed form: the first path covers all but a thousandth of the second."""
    flat = {
        "positions": np.zeros((1, 3), np.float32), "scales": np.full((1, 3), 9.0, np.float32),
        "rotations": np.float32([[1, 0, 0, 0]]), "opacities": np.ones(1, np.float32),
    }  # fmt: skip
    scene = RenderScene()
    for path, red in (("/b", -9.0), ("/a", 9.0)):
        sh = np.float32([[[red, -9.0, -9.0]]])
        scene.set_field(path, FieldSpec(cloud=SplatCloud(**flat, sh=sh)))
        scene.set_instances(path, (InstanceSpec(path=path),))
    ours = picture(scene, view_of(lens()))
    red = 0.5 + 9.0 * 0.28209479
    np.testing.assert_allclose(ours["color"][60, 70], [0.999 * red, 0, 0, 0.999], rtol=1e-5)
    assert ours["primId"][60, 70] == 0


def test_fields_in_two_color_spaces_are_blended_in_one():
    """Oracle: closed form: a linear 0.2140 is sRGB 0.5; alone it is shown as sRGB as well."""
    cloud = SplatCloud(
        positions=np.zeros((1, 3), np.float32), scales=np.full((1, 3), 9.0, np.float32),
        rotations=np.float32([[1, 0, 0, 0]]), opacities=np.ones(1, np.float32),
        sh=np.full((1, 1, 3), (0.21404114 - 0.5) / 0.28209479, np.float32),
    )  # fmt: skip
    linear = scene_of((cloud, np.eye(4)), color_space="lin_rec709_scene")
    alone = picture(linear, view_of(lens()))["color"][60, 70]
    np.testing.assert_allclose(alone[:3] / alone[3], 0.5, rtol=1e-4)
    scene = picture(linear, view_of(lens()), color_mode="scene")["color"][60, 70]
    np.testing.assert_allclose(scene[:3] / scene[3], 0.21404114, rtol=1e-4)
    linear.set_field("/z", FieldSpec(cloud=random_cloud(1, n=3), color_space="srgb_rec709_scene"))
    behind = np.eye(4)
    behind[2, 3] = 50
    linear.set_instances("/z", (InstanceSpec(path="/z", transform=tuple(behind.ravel())),))
    mixed = picture(linear, view_of(lens()))["color"][60, 70]
    np.testing.assert_allclose(mixed[:3] / mixed[3], 0.5, rtol=1e-3)


def test_an_empty_scene_is_transparent():
    """Oracle: there is nothing to see."""
    ours = picture(RenderScene(), view_of(lens()))
    assert not ours["color"].any()
    assert np.isinf(ours["depth"]).all()
    assert all((ours[name] == -1).all() for name in ("primId", "instanceId", "elementId"))


def test_an_unknown_aov_is_refused():
    """Oracle: the wording of errors."""
    with pytest.raises(UsageError, match="AOV: found 'beauty', expected one of color"):
        picture(RenderScene(), view_of(lens()), aovs=("beauty",))


def test_bounds_hold_every_splat_and_the_subject_leaves_strays_out():
    """Oracle: corners of the analytic footprint; one splat of a thousand lies far off."""
    positions = np.random.default_rng(0).uniform(-1, 1, (1000, 3)).astype(np.float32)
    positions[7] = 1000
    cloud = SplatCloud(
        positions=positions, scales=np.full((1000, 3), 0.1, np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (1000, 1)),
        opacities=np.ones(1000, np.float32), sh=np.zeros((1000, 1, 3), np.float32),
    )  # fmt: skip
    matrix = np.diag([2.0, 1.0, -1.0, 1.0])
    scene = scene_of((cloud, matrix))
    low, high = scene.bounds()
    reach = 0.1 * np.sqrt(2 * np.log(255))
    np.testing.assert_allclose(high[:2], [2 * (1000 + reach), 1000 + reach], rtol=1e-6)
    np.testing.assert_allclose(low[2], -1000 - reach, rtol=1e-6)
    assert np.all(np.abs(np.stack(scene.subject())) <= [2, 1, 1])
    scene.set_visible("/field0", False)
    assert scene.bounds() is None and scene.subject() is None
    scene.close()
    assert scene.paths == () and scene.splat_count == 0


def test_a_splat_that_is_not_finite_spoils_no_pixel(recwarn):
    """Oracle: without a place it is not seen; without a colour it is black, and nothing is NaN."""
    cloud = random_cloud(5, n=60)
    sh = cloud.sh.copy()
    sh[7, 0, 1], sh[9, 3, 2] = np.nan, np.inf
    scales = cloud.scales.copy()
    scales[11, 0] = np.inf
    positions = cloud.positions.copy()
    positions[13] = np.nan
    broken = SplatCloud(
        positions=positions, scales=scales, rotations=cloud.rotations, opacities=cloud.opacities,
        sh=sh,
    )  # fmt: skip
    ours = picture(scene_of((broken, np.eye(4))), view_of(lens()))
    assert np.isfinite(ours["color"]).all()
    assert not {11, 13} & set(np.unique(ours["elementId"]))
    assert scene_of((broken, np.eye(4))).bounds() is not None
    assert [str(warning.message) for warning in recwarn] == []


def one_by_one(*rows, **options):
    """Round splats of sigma 0.5, one for each (position, colour), and their picture."""
    positions, colors = (np.float32(column) for column in zip(*rows, strict=True))
    n = len(rows)
    cloud = SplatCloud(
        positions=positions, scales=np.full((n, 3), 0.5, np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)), opacities=np.ones(n, np.float32),
        sh=((colors[:, None] - 0.5) / 0.28209479).astype(np.float32),
    )  # fmt: skip
    return scene_of((cloud, np.eye(4)), **options)


def test_a_parallel_view_may_begin_behind_its_camera():
    """Oracle: the nearer of two splats covers the other, with depths of either sign."""
    red, green = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    camera = CameraSpec(
        orthographic=True, window=(-2.0, -2.0, 2.0, 2.0), clipping_range=(-100.0, 100.0)
    )
    view = View(camera=camera, framing=Framing(resolution=(32, 32)))
    for near, far in ((5.0, 3.0), (1.0, -1.0), (-3.0, -5.0)):  # the camera looks along -z
        ours = picture(one_by_one(((0, 0, far), red), ((0, 0, near), green)), view)
        assert ours["color"][16, 16, 1] > 0.9 and ours["color"][16, 16, 0] < 0.1
        assert ours["depth"][16, 16] == -near


@pytest.mark.parametrize("near", [0.0, -5.0, -100.0])
def test_a_perspective_view_shows_nothing_behind_its_eye(near):
    """Oracle: a pinhole: the splat behind is not there, the one in front is."""
    camera = CameraSpec(clipping_range=(near, 100.0))
    view = View(camera=camera, framing=Framing(resolution=(32, 32)))
    assert not picture(one_by_one(((0, 0, 3), (1, 1, 1))), view)["color"].any()
    assert picture(one_by_one(((0, 0, -3), (1, 1, 1))), view)["color"][16, 16, 3] > 0.9


def test_an_enormous_splat_still_covers_the_picture():
    """Oracle: closed form: a Gaussian a thousand million units wide is 1, capped at 0.999, here."""
    scene = one_by_one(((0, 0, 0), (0.2, 0.4, 0.6)))
    wide = InstanceSpec(path="/field0", transform=tuple(np.diag([1e9, 1e9, 1.0, 1.0]).ravel()))
    scene.set_instances("/field0", (wide,))
    ours = picture(scene, view_of(lens()))["color"]
    np.testing.assert_allclose(ours / 0.999, np.broadcast_to([0.2, 0.4, 0.6, 1], ours.shape), 1e-5)


@pytest.mark.parametrize("window", [(5, 5, 5, 9), (5, 5, 9, 5), (9, 5, 5, 9)])
def test_a_window_without_pixels_is_refused(window):
    """Oracle: the wording of errors."""
    with pytest.raises(UsageError, match=r"data window: found .*, expected x0 < x1 and y0 < y1"):
        picture(RenderScene(), view_of(lens(), window))


def test_a_renderer_that_was_closed_keeps_no_buffer():
    """Oracle: the list of idle buffers, after the last band of a picture that was going on."""
    renderer = Renderer(open_device())
    settings = RenderSettings(sorting="zDepth", color_mode="display")
    bands = renderer.render(scene_of((random_cloud(1), np.eye(4))), view_of(lens()), settings, AOVS)
    next(bands)
    renderer.close()
    assert list(bands) == []
    assert renderer._idle == []


def test_a_slow_consumer_is_not_booked_to_a_stage(monkeypatch):
    """Oracle: a clock that only the consumer moves on."""
    now = 0.0
    monkeypatch.setattr("usdsplat.render.frame_stats.time.perf_counter", lambda: now)
    renderer = Renderer(open_device())
    settings = RenderSettings(sorting="zDepth", color_mode="display")
    scene = scene_of((random_cloud(1), np.eye(4)))
    for _ in renderer.render(scene, view_of(lens()), settings, ("color",), band_pixels=150 * 16):
        now += 1000.0
    assert now == 7000.0
    assert set(renderer.stats.wall_ms.values()) == {0.0}
