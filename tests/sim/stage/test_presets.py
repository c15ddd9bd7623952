"""Tests of the preset simulations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.schema.clouds import cloud
from tests.sim.stage.stages import moved, place, rigid, world
from usdsplat import schema
from usdsplat.core.errors import OutputError, StageError, UsageError
from usdsplat.sim.stage.presets import PRESETS, author_preset
from usdsplat.sim.stage.recipe import StageRecipe, find_simulations, recipes


def capture(folder: Path, *, up: str = "Y", fields: int = 1) -> Usd.Stage:
    """A file with a field of 500 splats, twice as large as itself and turned."""
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    for number in range(fields):
        prim = schema.author(stage, f"/World/Scan{number}", cloud(number, n=500))
        place(prim, rigid(4, 2.0))
    stage.Save()
    return stage


def written(folder: Path, name: str, up: str = "Y") -> tuple[Usd.Stage, StageRecipe]:
    """A preset, opened again."""
    (folder / "shots").mkdir()
    author_preset(name, capture(folder, up=up), folder / "shots" / "sim.usda")
    stage = Usd.Stage.Open(str(folder / "shots" / "sim.usda"))
    (sim,) = find_simulations(stage)
    (recipe,) = recipes(stage, sim)
    return stage, recipe


def box(stage: Usd.Stage) -> np.ndarray:
    """The 5th and 95th percentiles of the splats in the world, shape (2, 3)."""
    prim = stage.GetPrimAtPath("/World/Scan0")
    points = moved(world(prim), schema.fetch(prim).positions)
    return np.percentile(points, (5, 95), axis=0)


@pytest.mark.parametrize("up", ["Y", "Z"])
@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_a_stage_that_holds_the_capture(name, up, tmp_path) -> None:
    """Oracle: USD and our validation; everything in it is read, at every frame."""
    stage, recipe = written(tmp_path, name, up)
    assert stage.GetRootLayer().subLayerPaths[0] == "../capture.usdc"
    assert not stage.GetCompositionErrors()
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 100)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 24
    assert UsdGeom.GetStageUpAxis(stage) == up and UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert str(stage.GetDefaultPrim().GetPath()) == "/World"
    assert [each for each in schema.validate(stage) if each.severity == "error"] == []
    assert recipe.path == "/World/Scan0" and len(recipe.rest) == 500 and recipe.findings == ()
    for frame in range(1, 101):
        recipe.at(frame)
    for prim in stage.Traverse():
        attributes = prim.GetAuthoredAttributes()
        assert not any(each.IsCustom() for each in attributes if "splatSim" in each.GetName())


@pytest.mark.parametrize("name", ["push", "grow"])
def test_a_ball_goes_through_the_middle_of_the_capture(name, tmp_path) -> None:
    """Oracle: the capture's box: outside it first and last, in its middle half-way."""
    stage, recipe = written(tmp_path, name)
    low, high = box(stage)
    ball = stage.GetPrimAtPath("/World/Simulation/Ball")
    radius = UsdGeom.Sphere(ball).GetRadiusAttr().Get()
    times = UsdGeom.Xformable(ball).GetTimeSamples()
    first, middle, last = (world(ball, t)[:3, 3] for t in (times[0], np.mean(times), times[-1]))
    assert np.allclose(middle, (low + high) / 2, atol=1e-5)
    for end in (first, last):
        outside = np.maximum(low - end, end - high).max()
        assert outside == pytest.approx(1.5 * radius, rel=1e-5)
    (affector,) = recipe.at(float(np.mean(times))).affectors
    assert affector.solids[0].size[0] == pytest.approx(radius / 2)  # the field is twice its size
    assert UsdGeom.Gprim(ball).GetDisplayColorAttr().Get()


def test_a_pattern_is_formed_by_the_last_frame(tmp_path) -> None:
    """Oracle: about 6,000 reaction steps; lengths are in units of the field."""
    stage, recipe = written(tmp_path, "grow")
    asked = recipe.at(1).parameters
    assert asked.rd.enabled and asked.rd.preset == "labyrinth"
    assert 5_500 <= 100 * asked.rd.substeps <= 6_500 and asked.growth.birth_rate > 0
    size = np.ptp(box(stage), axis=0).max() / 2
    assert asked.rd.pattern_scale == pytest.approx(size * np.sqrt(3 / 500), rel=1e-5)
    drivers = {each.parameters.output for each in recipe.at(1).drivers}
    assert drivers == {"color", "displacement", "scale"}


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_the_ring_lies_level_around_the_capture_and_faces_outwards(up, tmp_path) -> None:
    """Oracle: the torus: volume 2 pi^2 R r^2, its axis upright, its middle the capture's."""
    stage, recipe = written(tmp_path, "conform", up)
    low, high = box(stage)
    target = recipe.at(50).target
    assert target is not None
    points = moved(recipe.at(50).to_world, target.points)
    assert np.allclose(points.mean(axis=0), (low + high) / 2, atol=1e-4)
    axis = "XYZ".index(up)
    height = np.ptp(points[:, axis])
    off = np.linalg.norm(np.delete(points - (low + high) / 2, axis, axis=1), axis=1)
    radius, tube = (off.max() + off.min()) / 2, height / 2
    assert (off.max() - off.min()) / 2 == pytest.approx(tube, rel=1e-4)
    assert radius > np.hypot(*np.delete(high - low, axis)) / 2
    a, b, c = (points[target.triangles[:, i]] for i in range(3))
    volume = np.einsum("ti,ti->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(2 * np.pi**2 * radius * tube**2, rel=5e-3)
    assert recipe.at(1).parameters.conform.weight == 1
    at_rest = recipe.at(1).parameters.conform
    assert at_rest.start + at_rest.duration + at_rest.stagger < 99 / 24


def test_the_wind_blows_level_and_up_a_little(tmp_path) -> None:
    """Oracle: the stage's axes and the capture's size."""
    stage, recipe = written(tmp_path, "dissolve", "Z")
    asked = recipe.at(1).parameters
    size = np.ptp(box(stage), axis=0).max()
    assert asked.dissolve.enabled and asked.dissolve.by == "noise" and asked.particles.turbulence
    assert asked.particles.wind[2] == pytest.approx(0.15 * size, rel=1e-4)
    assert np.hypot(*asked.particles.wind[:2]) == pytest.approx(0.6 * size, rel=1e-4)
    assert asked.dissolve.size == pytest.approx(0.15 * size / 2, rel=1e-4)


def test_the_style_of_grow_is_the_pattern(tmp_path) -> None:
    """Oracle: the parameter on the stage."""
    author_preset("grow", capture(tmp_path), tmp_path / "a.usda", options={"style": "spots"})
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    (sim,) = find_simulations(stage)
    assert sim.GetAttribute("splatSim:rd:preset").Get() == "spots"


def test_a_target_is_referred_to_as_large_as_the_capture(tmp_path) -> None:
    """Oracle: the box of the capture: the same centre and longest edge; the path is relative, and
    the mesh is the one in the file."""
    figure = Usd.Stage.CreateNew(str(tmp_path / "figure.usda"))
    figure.SetDefaultPrim(UsdGeom.Xform.Define(figure, "/Figure").GetPrim())
    mesh = UsdGeom.Mesh.Define(figure, "/Figure/Body")
    mesh.CreatePointsAttr([(0, 0, 0), (3, 0, 0), (0, 1, 0), (0, 0, 2)])
    mesh.CreateFaceVertexCountsAttr([3] * 4)
    mesh.CreateFaceVertexIndicesAttr([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])
    mesh.CreateExtentAttr([(0, 0, 0), (3, 1, 2)])
    figure.Save()
    (tmp_path / "shots").mkdir()
    options = {"target": str(tmp_path / "figure.usda")}
    author_preset("conform", capture(tmp_path), tmp_path / "shots" / "a.usda", options=options)
    assert "@../figure.usda@" in (tmp_path / "shots" / "a.usda").read_text()
    stage = Usd.Stage.Open(str(tmp_path / "shots" / "a.usda"))
    (recipe,) = recipes(stage, *find_simulations(stage))
    target = recipe.at(1).target
    assert target is not None and len(target.triangles) == 4
    points = moved(recipe.at(1).to_world, target.points)
    low, high = box(stage)
    assert np.allclose((points.min(0) + points.max(0)) / 2, (low + high) / 2, atol=1e-5)
    assert np.ptp(points, axis=0).max() == pytest.approx((high - low).max(), rel=1e-5)


@pytest.mark.parametrize("name", PRESETS)
def test_what_acts_on_splats_is_not_part_of_the_picture(name, tmp_path) -> None:
    """Oracle: USD's purpose of every prim that the preset draws."""
    stage, _ = written(tmp_path, name)
    ours = Usd.PrimRange(stage.GetPrimAtPath("/World/Simulation"))
    drawn = [prim for prim in ours if prim.IsA(UsdGeom.Gprim)]
    assert {str(UsdGeom.Imageable(prim).ComputePurpose()) for prim in drawn} <= {"guide"}


def test_an_option_that_a_preset_does_not_take_is_one_sentence(tmp_path) -> None:
    """Oracle: the sentences; nothing is written."""
    stage = capture(tmp_path)

    def asked(name: str, **options: str) -> None:
        author_preset(name, stage, tmp_path / "a.usda", options=options)

    with pytest.raises(UsageError, match="--style: found 'wool', expected one of labyrinth, spots"):
        asked("grow", style="wool")
    with pytest.raises(UsageError, match=r"--target: found 'a.usd' and --preset grow, .* --style"):
        asked("grow", target="a.usd")
    with pytest.raises(UsageError, match=r"--style: .* --preset push, .*takes no option"):
        asked("push", style="x")
    with pytest.raises(StageError, match=r"capture.usdc: found 0 meshes, expected one"):
        asked("conform", target=str(tmp_path / "capture.usdc"))
    assert not (tmp_path / "a.usda").exists()


def test_what_cannot_be_a_preset_is_one_sentence(tmp_path) -> None:
    """Oracle: the sentences; a failure leaves nothing behind."""
    stage = capture(tmp_path)
    with pytest.raises(UsageError, match="preset: found 'melt', expected one of grow, push, con"):
        author_preset("melt", stage, tmp_path / "a.usda")
    with pytest.raises(UsageError, match="expected another file than the capture's"):
        author_preset("push", stage, tmp_path / "capture.usdc")
    with pytest.raises(OutputError):
        author_preset("push", stage, tmp_path / "nowhere" / "a.usda")
    with pytest.raises(StageError, match="found a stage without a file"):
        author_preset("push", Usd.Stage.CreateInMemory(), tmp_path / "a.usda")
    (tmp_path / "two").mkdir()
    with pytest.raises(StageError, match="found 2 splat fields, expected one"):
        author_preset("push", capture(tmp_path / "two", fields=2), tmp_path / "a.usda")
    author_preset("push", stage, tmp_path / "push.usda")
    with pytest.raises(StageError, match=r"found the simulation .*/Sim, expected"):
        author_preset("push", Usd.Stage.Open(str(tmp_path / "push.usda")), tmp_path / "a.usda")
    assert not (tmp_path / "a.usda").exists()


def test_results_over_it_are_stronger_than_the_capture(tmp_path) -> None:
    """Oracle: USD: an opinion of the preset's own layer wins over the sublayer."""
    stage, _ = written(tmp_path, "push")
    prim = stage.GetPrimAtPath("/World/Scan0")
    assert prim.GetPrimStack()[0].layer != stage.GetRootLayer()
    stage.OverridePrim("/World/Scan0").CreateAttribute("x", Sdf.ValueTypeNames.Int).Set(1)
    assert prim.GetPrimStack()[0].layer == stage.GetRootLayer()
