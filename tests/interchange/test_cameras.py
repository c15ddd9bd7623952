"""Tests of importing the cameras of photographs."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.formats.camera_files import (
    LENSES,
    SHOTS,
    Shot,
    colmap_binary,
    colmap_text,
    nerf_pose,
    projected,
    transforms,
)
from tests.renders import psnr
from usdsplat import formats, schema
from usdsplat.core import edit, quaternion
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.formats.cameras.lens import lens
from usdsplat.interchange import import_capture
from usdsplat.interchange.cameras import import_cameras
from usdsplat.interchange.options import ImportOptions
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing

SCALE_AND_TURN = np.array([[0, -2, 0, 1], [2, 0, 0, -3], [0, 0, 2, 0.5], [0, 0, 0, 1.0]])


def dots(positions) -> SplatCloud:
    """Small, opaque, white balls."""
    n = len(positions)
    return SplatCloud(
        positions=np.asarray(positions, np.float32),
        scales=np.full((n, 3), 0.02, np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacities=np.full(n, 0.999, np.float32),
        sh=np.full((n, 1, 3), 1.7724539, np.float32),
    )


def points(count=8):
    """Points that both photographs show."""
    rng = np.random.default_rng(3)
    return rng.uniform(-0.6, 0.6, (count, 3)).astype(np.float32)


def staged(folder, cloud, **options):
    """A stage in memory with a capture of the cloud, and its field."""
    formats.write(cloud, folder / "scan.ply")
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, options.pop("stage_up", "Y"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.1)
    report = import_capture(folder / "scan.ply", stage, options=ImportOptions(**options))
    return stage, stage.GetPrimAtPath(report.prim_path)


def pixels(prim, positions):
    """Where Gf's frustum has points of the world in the photograph [pixel]."""
    camera = UsdGeom.Camera(prim).GetCamera(Usd.TimeCode.Default())
    frustum = camera.frustum
    size = prim.GetCustomDataByKey("usdsplat:width"), prim.GetCustomDataByKey("usdsplat:height")
    matrix = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    ndc = np.array([matrix.Transform(Gf.Vec3d(*map(float, p))) for p in positions])
    return np.stack([(ndc[:, 0] + 1) / 2 * size[0], (1 - ndc[:, 1]) / 2 * size[1]], axis=1)


def in_world(field, positions):
    """Points of the field in the world."""
    matrix = np.array(UsdGeom.Imageable(field).ComputeLocalToWorldTransform(0))
    return (np.column_stack([positions, np.ones(len(positions))]) @ matrix)[:, :3]


@pytest.mark.parametrize("stage_up", ["Y", "Z"])
@pytest.mark.parametrize("bake_axes", [False, True])
@pytest.mark.parametrize("unit", [None, 2.5])
def test_points_are_where_colmap_has_them(tmp_path, stage_up, bake_axes, unit):
    """Oracle: COLMAP's projection by hand, against OpenUSD's own frustum of the camera."""
    stage, field = staged(
        tmp_path, dots(points()), stage_up=stage_up, bake_axes=bake_axes, meters_per_unit=unit
    )
    report = import_cameras(colmap_binary(tmp_path / "sparse/0"), field, meters_per_unit=unit)
    assert report.prim_paths == ("/scan/cameras/left_0001", "/scan/cameras/a_picture")
    world = in_world(field, schema.fetch(field).positions)
    for path, shot in zip(report.prim_paths, SHOTS, strict=True):
        found = pixels(stage.GetPrimAtPath(path), world)
        np.testing.assert_allclose(found, projected(shot, LENSES[shot.camera], points()), atol=2e-3)


@pytest.mark.parametrize("source", ["colmap", "nerf"])
def test_the_delegate_draws_points_where_the_photograph_has_them(tmp_path, source):
    """Oracle: COLMAP's projection by hand; a ball's middle is the middle of its pixels' weight."""
    taken = ("OPENCV", 320, 240, (300.0, 300.0, 150.0, 130.0, 0.0, 0.0, 0.0, 0.0))
    shot = Shot("a.png", (0.9, 0.1, -0.3, 0.2), (0.3, -0.2, 4.0))
    if source == "colmap":
        path = colmap_text(tmp_path / "sparse", [shot], {1: taken})
    else:
        frame = {"file_path": "a.png", "transform_matrix": nerf_pose(shot)}
        top = {"w": 320, "h": 240, "fl_x": 300.0, "cx": 150.0, "cy": 130.0}
        path = transforms(tmp_path / "transforms.json", [frame], **top)
    for point in points(3):
        stage, field = staged(tmp_path, dots([point]), stage_up="Z")
        (camera,) = import_cameras(path, field).prim_paths
        with Engine(stage) as engine:
            alpha = engine.picture(engine.view(camera, resolution=(320, 240)))["color"][..., 3]
        rows, columns = np.mgrid[:240, :320] + 0.5
        found = [(alpha * at).sum() / alpha.sum() for at in (columns, rows)]
        np.testing.assert_allclose(found, projected(shot, taken, point[None])[0], atol=0.02)


@pytest.mark.parametrize("name", ["statue_angel.sog", "pod.spz"])
def test_a_capture_is_seen_as_its_photographs_saw_it(data, tmp_path, name: str) -> None:
    """Oracle: gsplat 1.5.3 on CUDA through the same cameras, here from a model of COLMAP."""
    oracle = np.load(data / "oracle" / "images" / f"{name.split('.')[0]}.npz")
    (width, height), k = (int(oracle["width"]), int(oracle["height"])), oracle["K"]
    lenses = {1: ("PINHOLE", width, height, (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))}
    shots = []
    for i, matrix in enumerate(oracle["viewmats"].astype(np.float64)):
        turn = quaternion.from_matrix(matrix[None, :3, :3])[0]
        shots.append(Shot(f"view{i}.png", tuple(turn), tuple(matrix[:3, 3])))
    stage = Usd.Stage.CreateInMemory()
    report = import_capture(
        data / "splats" / name, stage, options=ImportOptions(meters_per_unit=0.5)
    )
    path = colmap_binary(tmp_path / "sparse", shots, lenses)
    field = stage.GetPrimAtPath(report.prim_path)
    seen = import_cameras(path, field, meters_per_unit=0.5)
    with Engine(stage) as engine:
        for camera, expected in zip(seen.prim_paths, oracle["classic_rgb"], strict=True):
            view = engine.view(camera, resolution=(width, height))
            color = engine.picture(view, RenderSettings(color_mode="display"))["color"]
            assert psnr(color[..., :3], expected) >= 60


def test_pixels_that_are_not_square_are_drawn_as_the_note_says(tmp_path):
    """Oracle: COLMAP's projection by hand, with fx 500 and fy 510."""
    stage, field = staged(tmp_path, dots(points(1)))
    report = import_cameras(colmap_text(tmp_path / "sparse", SHOTS[:1]), field)
    assert any("adjustPixelAspectRatio" in note for note in report.notes)
    framing = Framing(resolution=(640, 480), conform="adjustPixelAspectRatio")
    with Engine(stage) as engine:
        view = engine.view(report.prim_paths[0], framing=framing)
        alpha = engine.picture(view)["color"][..., 3]
    rows, columns = np.mgrid[:480, :640] + 0.5
    found = [(alpha * at).sum() / alpha.sum() for at in (columns, rows)]
    np.testing.assert_allclose(found, projected(SHOTS[0], LENSES[1], points(1))[0], atol=0.02)


def test_cameras_go_along_with_edits_and_with_the_fields_own_transform(tmp_path):
    """Oracle: what is moved evenly together with its camera gives the same picture."""
    cloud = edit.transform(dots(points()), SCALE_AND_TURN)
    stage, field = staged(tmp_path, cloud)
    UsdGeom.Xformable(field).AddTranslateOp().Set(Gf.Vec3d(5, 6, 7))
    path = colmap_binary(tmp_path / "sparse/0")
    report = import_cameras(path, field, edited=SCALE_AND_TURN)
    world = in_world(field, cloud.positions)
    for prim, shot in zip(map(stage.GetPrimAtPath, report.prim_paths), SHOTS, strict=True):
        expected = projected(shot, LENSES[shot.camera], points())
        np.testing.assert_allclose(pixels(prim, world), expected, atol=2e-3)


def test_what_a_lens_bends_is_told_and_kept(tmp_path):
    """Oracle: what was written; OPENCV's polynomial at the corners is that of the lens' tests."""
    stage, field = staged(tmp_path, dots(points()))
    report = import_cameras(colmap_binary(tmp_path / "sparse/0"), field)
    (bent,) = (note for note in report.notes if "distortion" in note)
    assert bent.startswith("1 photograph of 2 with lens distortion (OPENCV)")
    offset = lens("", LENSES[7][0], LENSES[7][1:3], LENSES[7][3]).displacement
    assert f"differ by up to {offset:.3g} pixels;" in bent
    entry = stage.GetPrimAtPath(report.prim_paths[1]).GetCustomDataByKey("usdsplat")
    assert (entry["image"], entry["width"], entry["height"]) == ("a picture.png", 400, 300)
    assert entry["lens"]["model"] == "OPENCV"
    assert entry["lens"]["distortion"] == {"k1": 0.1, "k2": -0.05, "p1": 0.001, "p2": 0.002}
    straight = stage.GetPrimAtPath(report.prim_paths[0]).GetCustomDataByKey("usdsplat")
    assert "distortion" not in straight["lens"]


@pytest.mark.parametrize("form", ["float", "half", "packed"])
def test_clipping_planes_hold_the_capture(tmp_path, form):
    """Oracle: depths by the pose that was written; 1 % of their median is the near plane."""
    stage, field = staged(tmp_path, dots(points()), form=form)
    report = import_cameras(colmap_binary(tmp_path / "sparse/0"), field)
    for prim, shot in zip(map(stage.GetPrimAtPath, report.prim_paths), SHOTS, strict=True):
        near, far = UsdGeom.Camera(prim).GetClippingRangeAttr().Get()
        depths = shot.seen(points())[:, 2]
        assert 0 < near < depths.min()
        assert near < 0.011 * np.median(depths)
        assert depths.max() + 0.06 < far < 2 * depths.max()


def test_cameras_of_a_second_capture_leave_the_first_ones_alone(tmp_path):
    """Oracle: names are taken once; images of one name in two folders are two cameras."""
    stage, field = staged(tmp_path, dots(points()))
    twins = [SHOTS[0], Shot("left.0001.png", (1, 0, 0, 0), (0, 0, 3))]
    path = colmap_text(tmp_path / "sparse", twins)
    first = import_cameras(path, field).prim_paths
    second = import_cameras(path, field).prim_paths
    assert first == ("/scan/cameras/left_0001", "/scan/cameras/left_0001_1")
    assert second == ("/scan/cameras_1/left_0001", "/scan/cameras_1/left_0001_1")
    assert all(stage.GetPrimAtPath(path).IsA(UsdGeom.Camera) for path in (*first, *second))


def test_what_no_camera_can_do_is_refused_before_anything_is_written(tmp_path):
    """Oracle: a person's expectation; a mirrored photograph is no photograph."""
    path = colmap_text(tmp_path / "sparse")
    stage, field = staged(tmp_path, dots(points()), bake_axes=True)
    with pytest.raises(UsageError, match="left-handed"):
        import_cameras(path, field, frame="ruf")
    with pytest.raises(UsageError, match="edited"):
        import_cameras(path, field, edited=np.diag([1.0, 2, 1, 1]))
    UsdGeom.Xformable(field).AddScaleOp().Set(Gf.Vec3f(1, 2, 1))
    with pytest.raises(StageError, match="/scan/splats"):
        import_cameras(path, field)
    assert not stage.GetPrimAtPath("/scan/cameras")


def test_numbered_photographs_keep_their_numbers(tmp_path):
    """Oracle: USD's rule, no digit first; 0001 and 1001 are not told apart by their order."""
    _, field = staged(tmp_path, dots(points()))
    shots = [Shot(f"{number}.png", (1, 0, 0, 0), (0, 0, 3)) for number in ("0001", "1001")]
    report = import_cameras(colmap_text(tmp_path / "sparse", shots), field)
    assert report.prim_paths == ("/scan/cameras/_0001", "/scan/cameras/_1001")


@pytest.mark.parametrize("unit", [1.0, 2.0])
def test_the_size_of_the_photographs_pixels_is_on_the_field(tmp_path, unit) -> None:
    """Oracle: the depths of the points that a photograph shows, over its focal length, median;
    a capture that was divided by two has a local unit of twice the size."""
    cloud = edit.transform(dots(points()), np.diag([1 / unit] * 3 + [1.0]))
    _stage, field = staged(tmp_path, cloud)
    folder, edited = colmap_text(tmp_path / "sparse"), np.diag([1 / unit] * 3 + [1.0])
    import_cameras(folder, field, edited=edited)
    sizes = [
        np.median(shot.seen(points())[:, 2]) / np.sqrt(np.prod(LENSES[shot.camera][3][:2]))
        for shot in SHOTS
    ]
    size = schema.footprint(field) * unit
    assert size == pytest.approx(np.median(sizes), rel=1e-5)
