"""Tests of masks on a stage: what is read, and what is said about mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.sim.stage.stages import (
    field_of,
    make_stage,
    moved,
    place,
    rigid,
    simulation_of,
    world,
)
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.findings import Finding
from usdsplat.kernels.devices import open_device
from usdsplat.sim.masks import Masks
from usdsplat.sim.stage.authoring import author, relate
from usdsplat.sim.stage.overrides import override
from usdsplat.sim.stage.parameters import instances
from usdsplat.sim.stage.recipe import StageRecipe, recipes
from usdsplat.sim.state import State

VDB = Path(__file__).parents[2] / "data" / "ball.vdb"
"""A level set of a ball of radius 0.5 about (0.1, 0.2, -0.1), of voxels of 0.125, and a grid of
densities; written by OpenVDB 10.0.1."""


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


def only(stage: Usd.Stage) -> StageRecipe:
    """The recipe of the only field."""
    (recipe,) = recipes(stage, simulation_of(stage))
    return recipe


def made(**values: Any) -> Usd.Stage:
    """A stage with a mask `m`, bound to settle:omega."""
    stage = make_stage()
    names = {f"mask:m:{name}": value for name, value in values.items()}
    author(simulation_of(stage), {**names, "settle:omega:mask": "m"})
    return stage


def factor(device: Any, stage: Usd.Stage, time: float = 1) -> np.ndarray:
    """The factor of settle:omega of the splats at rest."""
    recipe = only(stage)
    state, moment = State.of(recipe.rest), recipe.at(time)
    masks = Masks(device, is_fixed=True)
    masks.begin(state, moment)
    found = masks.factor(state, moment, "settle:omega")
    assert found is not None
    return found


def points(stage: Usd.Stage) -> np.ndarray:
    """The splats in the field's space."""
    return only(stage).rest.positions.astype(np.float64)


def picture(pixels: np.ndarray, path: Path) -> None:
    """Write a picture by another library than the one that reads it."""
    from PIL import Image

    Image.fromarray(pixels).save(path)


def said(stage: Usd.Stage) -> list[Finding]:
    """The findings about masks."""
    return [each for each in only(stage).findings if "mask" in each.told]


# --- sources --------------------------------------------------------------------------------


def test_a_primvar_of_the_field_is_a_mask(device) -> None:
    """Oracle: the numbers; at another time its samples."""
    stage = made(source="primvar", primvar="paint")
    paint = UsdGeom.PrimvarsAPI(field_of(stage)).CreatePrimvar(
        "paint", Sdf.ValueTypeNames.FloatArray, "vertex"
    )
    early, late = np.linspace(0, 1, 50, dtype=np.float32), np.full(50, 0.25, np.float32)
    paint.Set(Vt.FloatArray.FromNumpy(early), 1)
    paint.Set(Vt.FloatArray.FromNumpy(late), 9)
    assert np.allclose(factor(device, stage, 1), early, atol=1e-7)
    assert np.allclose(factor(device, stage, 9), late, atol=1e-7)


def test_an_axis_is_that_of_a_prim(device) -> None:
    """Oracle: USD's transforms: the height in the frame's space."""
    stage = made(source="axis", clamp=False)
    place(field_of(stage), rigid(2, 0.5))
    frame = UsdGeom.Xform.Define(stage, "/World/Frame").GetPrim()
    place(frame, rigid(4, 2.0))
    relate(simulation_of(stage), "mask:m:frame", frame)
    there = moved(np.linalg.inv(world(frame)) @ world(field_of(stage)), points(stage))
    assert np.allclose(factor(device, stage), np.clip(there[:, 1], 0, 100 / 8), atol=1e-5)


def test_a_region_is_an_affector_that_does_nothing_else(device) -> None:
    """Oracle: a ball of the prim's radius; the simulation has no collision."""
    stage = made(source="affector")
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.CreateRadiusAttr(1.0)
    author(ball.GetPrim(), {"affector:role": "region"})
    relate(simulation_of(stage), "mask:m:region", ball.GetPrim())
    inside = np.linalg.norm(points(stage), axis=1) < 1
    assert 0 < inside.sum() < 50
    assert np.array_equal(factor(device, stage), inside)


@pytest.mark.parametrize("kind", ["linear", "bezier", "bspline", "catmullRom", "pinned"])
def test_curves_are_read_as_their_basis_says(device, kind: str) -> None:
    """Oracle: a straight line in each basis, closed at no end; twice as far away, half the mask."""
    stage = made(source="curves", radius=0.0, falloff=4.0, clamp=False)
    curves = UsdGeom.BasisCurves.Define(stage, "/World/Curves")
    along = np.linspace(-3, 3, 7)
    if kind == "bspline":  # without the repeated ends it does not reach them
        along = np.array([-3, -3, -3, -1, 0, 1, 3, 3, 3], float)
    if kind == "catmullRom":
        along = np.array([-4, -3, -1, 0, 1, 3, 4], float)
    curves.CreatePointsAttr([(float(x), 0, 0) for x in along])
    curves.CreateCurveVertexCountsAttr([len(along)])
    is_cubic = kind != "linear"
    curves.CreateTypeAttr("cubic" if is_cubic else "linear")
    curves.CreateBasisAttr(kind if is_cubic and kind != "pinned" else "bspline")
    if kind == "pinned":
        curves.CreateWrapAttr("pinned")
    relate(simulation_of(stage), "mask:m:region", curves.GetPrim())
    p = points(stage)
    nearest = np.clip(p[:, 0], -3, 3)
    distance = np.sqrt((p[:, 0] - nearest) ** 2 + p[:, 1] ** 2 + p[:, 2] ** 2)
    t = np.clip(distance / 4, 0, 1)
    assert np.allclose(factor(device, stage), 1 - t * t * (3 - 2 * t), atol=1e-4)


def test_periodic_curves_close(device) -> None:
    """Oracle: the distance to a square of four segments."""
    stage = made(source="curves", radius=0.4)
    curves = UsdGeom.BasisCurves.Define(stage, "/World/Curves")
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    curves.CreatePointsAttr(corners)
    curves.CreateCurveVertexCountsAttr([4])
    curves.CreateTypeAttr("linear")
    curves.CreateWrapAttr("periodic")
    relate(simulation_of(stage), "mask:m:region", curves.GetPrim())
    p = points(stage)
    x, y = np.abs(p[:, 0]), np.abs(p[:, 1])
    flat = np.where(
        (x <= 1) & (y <= 1),
        np.minimum(1 - x, 1 - y),
        np.hypot(np.maximum(x - 1, 0), np.maximum(y - 1, 0)),
    )
    assert np.array_equal(factor(device, stage) > 0, np.hypot(flat, p[:, 2]) <= 0.4)


def test_a_texture_is_projected_from_its_frame(device, tmp_path) -> None:
    """Oracle: a picture whose left half is white, seen along z; raw numbers, and alpha."""
    pixels = np.zeros((8, 8, 4), np.uint8)
    pixels[:, :4, :3], pixels[:, :, 3] = 255, 51
    picture(pixels, tmp_path / "left.png")
    stage = made(source="texture", file=str(tmp_path / "left.png"), wrap="clamp")
    frame = UsdGeom.Xform.Define(stage, "/World/Frame").GetPrim()
    place(frame, np.diag([8.0, 8.0, 8.0, 1.0]))
    relate(simulation_of(stage), "mask:m:frame", frame)
    found, x = factor(device, stage), points(stage)[:, 0]
    assert (found[x < -0.6] == 1).all() and (found[x > 0.6] == 0).all()
    author(simulation_of(stage), {"mask:m:channel": "a"})
    assert np.allclose(factor(device, stage), 0.2, atol=1e-6)


def test_a_texture_through_a_camera_follows_its_lens(device, tmp_path) -> None:
    """Oracle: a white picture covers what the camera sees."""
    picture(np.full((4, 4), 255, np.uint8), tmp_path / "white.png")
    file = str(tmp_path / "white.png")
    stage = made(source="texture", file=file, projection="camera")
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFocalLengthAttr(50.0)
    camera.CreateHorizontalApertureAttr(25.0)
    camera.CreateVerticalApertureAttr(50.0)
    matrix = np.eye(4)
    matrix[2, 3] = 5.0
    place(camera.GetPrim(), matrix)
    with pytest.raises(StageError, match="m:frame: found no Camera and projection camera"):
        only(stage).at(1)
    relate(simulation_of(stage), "mask:m:frame", camera.GetPrim())
    p = points(stage)
    depth = 5 - p[:, 2]
    seen = (np.abs(p[:, 0]) <= depth * 0.25) & (np.abs(p[:, 1]) <= depth * 0.5)
    assert 0 < seen.sum() < 50 and np.array_equal(factor(device, stage) > 0, seen)


def test_a_volume_is_a_region_around_its_surface(device) -> None:
    """Oracle: the ball that the file holds, up to half a voxel."""
    pytest.importorskip("tinyvdb")
    stage = made(source="volume", file=str(VDB), radius=0.3, falloff=1.0)
    t = np.linalg.norm(points(stage) - (0.1, 0.2, -0.1), axis=1) - 0.5 - 0.3
    t = np.clip(t, 0, 1)
    steepest, half = 1.5, 0.125 / 2
    assert np.abs(factor(device, stage) - (1 - t * t * (3 - 2 * t))).max() < steepest * half
    assert only_files(stage) == (str(VDB),)


def only_files(stage: Usd.Stage) -> tuple[str, ...]:
    """The files of a recipe that has been read."""
    recipe = only(stage)
    recipe.at(1)
    return recipe.files


@pytest.mark.parametrize(
    ("file", "grid", "sentence"),
    [
        (str(VDB), "density", ""),
        (str(VDB), "heat", "surface, density and no heat, expected the name of one"),
        (__file__, "", "expected an OpenVDB file"),
    ],
)
def test_a_file_without_the_level_set_is_one_sentence(file: str, grid: str, sentence: str) -> None:
    """Oracle: the sentences, with the attribute."""
    pytest.importorskip("tinyvdb")
    stage = made(source="volume", file=file, grid=grid)
    if grid == "density":  # any grid of numbers may be read by name
        only(stage).at(1)
        return
    with pytest.raises(StageError, match=rf"/World/Sim.splatSim:mask:m:file: .*{sentence}"):
        only(stage).at(1)


def test_the_same_mask_is_the_same_object(tmp_path) -> None:
    """Oracle: identity, which lets a solver skip what has not changed."""
    picture(np.full((4, 4), 255, np.uint8), tmp_path / "white.png")
    stage = made(source="texture", file=str(tmp_path / "white.png"), inMin=0.1)
    recipe = only(stage)
    assert recipe.at(1).masks["m"] is recipe.at(2).masks["m"]
    author(simulation_of(stage), {"mask:m:inMin": 0.2}, time=1)
    author(simulation_of(stage), {"mask:m:inMin": 0.4}, time=3)
    first, second = recipe.at(1).masks["m"], recipe.at(3).masks["m"]
    assert first is not second and second.parameters.in_min == pytest.approx(0.4)


# --- bindings -------------------------------------------------------------------------------


def test_masks_are_bound_to_parameters_of_all_parts() -> None:
    """Oracle: by hand."""
    stage = made(source="noise")
    sim = simulation_of(stage)
    author(
        sim,
        {"deform:a:left:weight:mask": "m", "driver:glow:amount:mask": "m", "rd:feed:mask": "m"},
    )
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball").GetPrim()
    author(ball, {"affector:role": "wind", "affector:amount:mask": "m"})
    assert instances(sim, "deform") == ["a:left"] and instances(sim, "driver") == ["glow"]
    assert dict(only(stage).at(1).masked) == {
        "settle:omega": ("m",), "deform:a:left:weight": ("m",), "driver:glow:amount": ("m",),
        "rd:feed": ("m",), "/World/Ball.affector:amount": ("m",),
    }  # fmt: skip
    attribute = sim.GetAttribute("splatSim:rd:feed:mask")
    assert attribute.GetTypeName() == Sdf.ValueTypeNames.Token and not attribute.IsCustom()
    assert attribute.GetVariability() == Sdf.VariabilityUniform and said(stage) == []


def test_a_mask_is_set_from_the_command_line() -> None:
    """Oracle: the binding; a parameter without masks is one sentence."""
    stage = made(source="noise")
    override(stage, "growth:rate:mask=m")
    assert only(stage).at(1).masked["growth:rate"] == ("m",)
    with pytest.raises(UsageError, match="found a mask of rd:substeps, expected a parameter that"):
        override(stage, "rd:substeps:mask=m")
    with pytest.raises(StageError, match="found no mask 'x', expected one of m"):
        override(stage, "mask:x:size=2")


def test_an_old_mask_of_a_deformer_is_one_of_its_weight(device) -> None:
    """Oracle: the primvar, times the mask of the weight if there is one; numbers above 1 stay."""
    stage = made(source="noise", outMin=0.5, outMax=0.5)
    sim = simulation_of(stage)
    author(sim, {"deform:bow:mask": "arm", "deform:bow:weight:mask": "m"})
    arm = np.linspace(0, 2, 50, dtype=np.float32)
    UsdGeom.PrimvarsAPI(field_of(stage)).CreatePrimvar(
        "arm", Sdf.ValueTypeNames.FloatArray, "vertex"
    ).Set(Vt.FloatArray.FromNumpy(arm))
    recipe = only(stage)
    state, moment = State.of(recipe.rest), recipe.at(1)
    masks = Masks(device, is_fixed=True)
    masks.begin(state, moment)
    (deformer,) = moment.deformers
    found = masks.factor(state, moment, "deform:bow:weight", deformer.parameters)
    assert np.array_equal(found, arm * np.float32(0.5))


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"mask:m:source": "primvar"}, r"mask:m:primvar: found '', which does not exist"),
        ({"mask:m:source": "affector"}, r"mask:m:region: found no target, expected an affector"),
        ({"mask:m:source": "curves"}, r"mask:m:region: found no target, expected BasisCurves"),
        ({"mask:m:source": "texture"}, r"mask:m:file: found none, expected a picture"),
        (
            {"mask:m:source": "texture", "mask:m:file": "nowhere.png"},
            r"mask:m:file: found nowhere.png, which does not exist",
        ),
        ({"mask:m:source": "masks"}, r"mask:m:inputs: found no names, expected the names of masks"),
        (
            {"mask:m:source": "masks", "mask:m:inputs": ("x",)},
            r"mask:m:inputs: found 'x', expected one of m",
        ),
        (
            {"mask:m:source": "masks", "mask:m:inputs": ("m",)},
            r"mask:m:inputs: found m among its own inputs",
        ),
        (
            {"mask:m:source": "noise", "rd:feed:mask": "n"},
            r"rd:feed:mask: found 'n', expected a mask of",
        ),
        ({"dissolve:by": "mask"}, r"dissolve:by: found mask, and no mask of it"),
    ],
)
def test_a_mask_that_cannot_be_is_one_sentence(values: dict[str, Any], sentence: str) -> None:
    """Oracle: the sentences, with the attribute."""
    stage = make_stage()
    author(simulation_of(stage), values)
    with pytest.raises(StageError, match=rf"/World/Sim\.splatSim:{sentence}"):
        only(stage).at(1)


def test_masks_without_effect_are_findings() -> None:
    """Oracle: the codes and the sentences."""
    stage = made(source="v")
    sim = simulation_of(stage)
    for name in ("splatSim:rd:substeps:mask", "splatSim:deform:bow:length:mask"):
        sim.CreateAttribute(name, Sdf.ValueTypeNames.Token).Set("m")
    author(sim, {"dissolve:by:mask": "m", "deform:bow:angle": 3.0})
    found = {(each.code, each.attribute.removeprefix("splatSim:")) for each in said(stage)}
    assert found == {
        ("not-masked", "rd:substeps:mask"), ("not-masked", "deform:bow:length:mask"),
        ("unused", "dissolve:by:mask"), ("unused", "mask:m:source"),
    }  # fmt: skip
    assert instances(sim, "deform") == ["bow"]
