"""Tests that equivalent stages give the same picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender

from tests.delegate.stages import add_camera, random_cloud
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.delegate.engine import Engine
from usdsplat.render.framing import data_window
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing

SIZE = (160, 120)


def psnr(found, expected):
    """Peak signal to noise ratio [dB] with a peak of 1; infinite when equal."""
    error = np.mean((np.asarray(found, np.float64) - expected) ** 2)
    return np.inf if error == 0 else -10 * np.log10(error)


def picture(stage, *, time=None, camera="/Camera", **settings):
    """What the stage's camera sees."""
    with Engine(stage, time=time) as engine:
        assert engine.warnings == ()
        view = engine.view(camera, resolution=SIZE)
        pixels = engine.picture(view, RenderSettings(**settings))["color"]
    assert pixels[..., 3].max() > 0.3, "there is nothing to compare"
    return pixels


def stage_of(cloud, matrix=None, **options):
    """A prim, its matrix as one xform op, and a camera."""
    stage = Usd.Stage.CreateInMemory()
    prim = schema.author(stage, "/Splats", cloud, **options)
    if matrix is not None:
        UsdGeom.Xformable(prim).AddTransformOp().Set(Gf.Matrix4d(np.asarray(matrix).T))
    add_camera(stage)
    return stage


def affine(kind):
    rng = np.random.default_rng(3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    linear = {
        "rotated": turn,
        "mirrored": turn @ np.diag([-1.0, 1.0, 1.0]),
        "unevenly scaled": turn @ np.diag([0.5, 1.7, 1.1]) @ turn.T @ turn.T,
        "sheared and mirrored": np.eye(3) + np.array([[0, 0.8, 0], [0, 0, -0.4], [0, 0, -1.9]]),
    }[kind]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, (0.4, -0.3, 0.8)
    return matrix


@pytest.mark.parametrize("kind", ["rotated", "mirrored", "unevenly scaled", "sheared and mirrored"])
def test_a_transformed_prim_looks_like_a_transformed_cloud(kind):
    """Oracle: core.edit.transform on the arrays, harmonics of degree 3 included; >= 60 dB."""
    cloud = random_cloud(5, n=300, degree=3)
    matrix = affine(kind)
    by_prim = picture(stage_of(cloud, matrix))
    by_cloud = picture(stage_of(edit.transform(cloud, matrix)))
    assert psnr(by_prim, by_cloud) >= 60
    assert psnr(by_prim, picture(stage_of(cloud))) < 40


def test_transforms_nest_and_instances_turn_their_harmonics():
    """Oracle: the same cloud moved by the product of the matrices; >= 60 dB."""
    cloud = random_cloud(6, n=200, degree=3)
    first, second = affine("mirrored"), affine("rotated")
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Asset/Splats", cloud)
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    UsdGeom.Xform.Define(stage, "/World").AddTransformOp().Set(Gf.Matrix4d(first.T))
    inner = UsdGeom.Xform.Define(stage, "/World/Inner")
    inner.AddTransformOp().Set(Gf.Matrix4d(second.T))
    inner.GetPrim().GetReferences().AddInternalReference("/Asset")
    inner.GetPrim().SetInstanceable(True)
    add_camera(stage)
    expected = picture(stage_of(edit.transform(cloud, first @ second)))
    assert psnr(picture(stage), expected) >= 60


@pytest.mark.parametrize("baked", [False, True], ids=["by its transform", "by its arrays"])
def test_fifty_units_from_the_origin_lose_nothing(baked):
    """Oracle: the same capture and camera at the origin; >= 60 dB."""
    cloud = random_cloud(7, n=300, degree=2)
    offset = np.eye(4)
    offset[:3, 3] = (50.0, -50.0, 50.0)
    stage = stage_of(edit.transform(cloud, offset)) if baked else stage_of(cloud, offset)
    stage.GetAttributeAtPath("/Camera.xformOp:translate").Set(Gf.Vec3d(50, -50, 60))
    assert psnr(picture(stage), picture(stage_of(cloud))) >= 60


HALVES = [
    (1.0, 0.0, 0.0), (1.5, 0.25, 0.0), (2.0, 0.5, 0.0), (3.0, 1.0, 1.0), (0.0, 0.0, 0.0),
    (9.0, 1.0, 1.0),
]  # fmt: skip
"""Time, how far between samples at 1 and 3 it is, and the same where values are held."""


@pytest.mark.parametrize("form", ["float", "half", "packed"])
@pytest.mark.parametrize("held", [False, True], ids=["linear", "held"])
def test_moving_positions_are_right_at_every_time(form, held):
    """Oracle: a static stage with the positions interpolated by NumPy."""
    first = random_cloud(8, n=100)
    shift = np.random.default_rng(0).normal(size=(100, 3)).astype(np.float32)
    second = replace(first, positions=first.positions + shift)
    stage = stage_of(first, form=form, time=1)
    schema.author(stage, "/Splats", second, form=form, time=3)
    if held:
        stage.SetInterpolationType(Usd.InterpolationTypeHeld)
    with Engine(stage, time=1) as engine:
        view = engine.view("/Camera", resolution=SIZE)
        for time, linear, steps in HALVES:
            part = np.float32(steps if held else linear)
            moment = replace(first, positions=first.positions + part * shift)
            expected = picture(stage_of(moment, form=form))
            engine.set_time(time)
            assert psnr(engine.picture(view)["color"], expected) >= 60


@pytest.mark.parametrize("held", [False, True], ids=["linear", "held"])
def test_a_moving_transform_is_right_at_every_time(held):
    """Oracle: a static stage turned by the angle worked out by hand."""
    cloud = random_cloud(9, n=100, degree=2)
    stage = stage_of(cloud)
    op = UsdGeom.Xformable(stage.GetPrimAtPath("/Splats")).AddRotateYOp()
    op.Set(0.0, 1)
    op.Set(90.0, 3)
    if held:
        stage.SetInterpolationType(Usd.InterpolationTypeHeld)
    with Engine(stage, time=1) as engine:
        view = engine.view("/Camera", resolution=SIZE)
        for time, linear, steps in HALVES:
            angle = np.radians(90.0 * (steps if held else linear))
            turn = np.eye(4)
            turn[[0, 0, 2, 2], [0, 2, 0, 2]] = (
                np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle),
            )  # fmt: skip
            engine.set_time(time)
            found = engine.picture(view)["color"]
            assert psnr(found, picture(stage_of(cloud, turn))) >= 60
        assert engine.pulls["field"] == 1


@pytest.fixture(scope="module")
def capture(any_device, data):
    """A real capture, upright, with overscan all around its display window."""
    cloud = formats.read(data / "splats" / "flowers_lod3_0.sog").cloud
    stage = Usd.Stage.CreateInMemory()
    prim = schema.author(stage, "/Capture", cloud)
    UsdGeom.Xformable(prim).AddRotateXOp().Set(180.0)
    with Engine(stage) as engine:
        view = engine.view(resolution=(320, 240))
        framing = replace(view.framing, data_window=(-60, -50, 390, 300))
        aovs = ("color", "depth", "primId", "elementId")
        full = engine.picture(replace(view, framing=framing), aovs=aovs)
    return stage, view, framing.data_window, full


@pytest.mark.parametrize(
    "window",
    [
        (0, 0, 320, 240), (100, 80, 101, 81), (37, 41, 203, 187), (0, 0, 16, 16),
        (-17, -33, 50, 70), (300, 200, 390, 300), (-60, -50, 1, 1),
    ],
)  # fmt: skip
def test_any_crop_and_overscan_has_the_full_pictures_pixels(capture, window):
    """Oracle: the full picture's own pixels, bit for bit."""
    stage, view, (left, top, _, _), full = capture
    x0, y0, x1, y1 = window
    with Engine(stage, threads=1) as engine:
        framing = replace(view.framing, data_window=window)
        found = engine.picture(replace(view, framing=framing), aovs=tuple(full))
    for name, pixels in found.items():
        expected = full[name][y0 - top : y1 - top, x0 - left : x1 - left]
        np.testing.assert_array_equal(pixels, expected)


def test_a_products_data_window_is_a_crop_of_its_display_window(capture):
    """Oracle: the full picture's own pixels, bit for bit."""
    stage, view, (left, top, _, _), full = capture
    ndc = (0.25, 0.5, 1.125, 1.0)
    assert data_window(ndc, (320, 240)) == (80, 0, 360, 120)
    session = Usd.Stage.Open(stage.GetRootLayer())
    settings = UsdRender.Settings.Define(session, "/Settings")
    settings.CreateProductsRel().SetTargets(["/Product"])
    product = UsdRender.Product.Define(session, "/Product")
    product.CreateResolutionAttr(Gf.Vec2i(320, 240))
    product.CreateDataWindowNDCAttr(Gf.Vec4f(*ndc))
    with Engine(session) as engine:
        (spec,) = engine.products()
        found = engine.picture(replace(view, framing=spec.framing), spec.settings, spec.aovs)
    expected = full["color"][-top : 120 - top, 80 - left : 360 - left]
    np.testing.assert_array_equal(found["color"], expected)


def test_framing_changes_pixels_as_it_says():
    """Oracle: an anamorphic picture squeezed by two is every other column's width: compared with
    the unsqueezed one at twice the columns, averaged in pairs."""
    stage = stage_of(random_cloud(11, n=200))
    with Engine(stage) as engine:
        squeezed = engine.view(
            "/Camera", framing=Framing(resolution=(80, 120), pixel_aspect_ratio=2.0)
        )
        plain = engine.view("/Camera", resolution=(160, 120))
        narrow = engine.picture(squeezed)["color"]
        wide = engine.picture(plain)["color"].reshape(120, 80, 2, 4).mean(axis=2)
    assert psnr(narrow, wide) > 35
    assert psnr(narrow[:, ::-1], wide) < 30


def test_rasterize_mode_and_degree_are_the_settings_or_the_prims():
    """Oracle: prims and clouds that say it themselves."""
    cloud = random_cloud(12, n=200, degree=2)
    tiny = replace(cloud, scales=cloud.scales * np.float32(0.1))
    kept, antialiased = (
        picture(stage_of(tiny, drawing=schema.DrawingHints(rasterize_mode=mode)))
        for mode in ("classic", "antialiased")
    )
    assert not np.array_equal(kept, antialiased)
    classic = schema.DrawingHints(rasterize_mode="classic")
    named = picture(stage_of(tiny, drawing=classic), rasterize_mode="antialiased")
    np.testing.assert_array_equal(named, antialiased)
    small = schema.DrawingHints(footprint=1e-9)  # no low-pass at all: antialiased
    np.testing.assert_array_equal(picture(stage_of(tiny, drawing=small)), antialiased)
    unknown = picture(stage_of(tiny, drawing=classic), rasterize_mode="footprint")
    np.testing.assert_array_equal(unknown, kept)
    flat = picture(stage_of(replace(cloud, sh=cloud.sh[:, :1])))
    np.testing.assert_allclose(picture(stage_of(cloud), sh_degree=0), flat, atol=1e-6)


def test_pictures_that_are_held_do_not_change():
    """While others are drawn with one sample or many. Oracle: copies of the pictures."""
    with Engine(stage_of(random_cloud(200))) as engine:
        held, copies = [], []
        for number, samples in enumerate((1, 1, 4, 4, 1, 4)):
            framing = Framing(resolution=SIZE, data_window=(number, 0, 128 + number, 96))
            view = engine.view("/Camera", framing=framing)
            found = engine.picture(view, RenderSettings(samples=samples), ("color", "depth"))
            found |= engine.picture(view, RenderSettings(samples=samples), ("albedo",))
            held.append(found)
            copies.append({name: each.copy() for name, each in found.items()})
        assert len({each["color"].tobytes() for each in copies}) == len(copies)
    for one, other in zip(held, copies, strict=True):
        for name, each in one.items():
            np.testing.assert_array_equal(each, other[name])
            assert each.flags.c_contiguous and not each.flags.writeable
