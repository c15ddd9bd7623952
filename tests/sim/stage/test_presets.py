"""Tests of the preset simulations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.schema.clouds import cloud
from tests.sim.stage.stages import moved, place, rigid, world
from usdsplat import schema
from usdsplat.core.errors import OutputError, StageError, UsageError
from usdsplat.sim.stage.presets import PRESETS, author_preset
from usdsplat.sim.stage.recipe import StageRecipe, find_simulations, recipes
from usdsplat.sim.styles import STYLES


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


def other(folder: Path) -> Usd.Stage:
    """A file with another field of 300 splats."""
    stage = Usd.Stage.CreateNew(str(folder / "other.usdc"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Other").GetPrim())
    place(schema.author(stage, "/Other/Splats", cloud(9, n=300)), rigid(5, 3.0))
    stage.Save()
    return stage


def block(folder: Path, up: str = "Z") -> Usd.Stage:
    """A file with two boxes on each other: 2 x 3 and 9 high."""
    stage = Usd.Stage.CreateNew(str(folder / "block.usda"))
    UsdGeom.SetStageUpAxis(stage, up)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Block").GetPrim())
    for name, height, middle in (("Low", 4.0, 2.0), ("High", 5.0, 6.5)):
        cube = UsdGeom.Cube.Define(stage, f"/Block/{name}")
        cube.CreateSizeAttr(1.0)
        size = (2, 3, height) if up == "Z" else (2, height, 3)
        cube.AddTranslateOp().Set((0, 0, middle) if up == "Z" else (0, middle, 0))
        cube.AddScaleOp().Set(size)
    stage.Save()
    return stage


def written(folder: Path, name: str, up: str = "Y") -> tuple[Usd.Stage, StageRecipe]:
    """A preset, opened again."""
    (folder / "shots").mkdir()
    goal = other(folder) if name == "morph" else None
    author_preset(name, capture(folder, up=up), folder / "shots" / "sim.usda", goal=goal)
    stage = Usd.Stage.Open(str(folder / "shots" / "sim.usda"))
    (sim,) = find_simulations(stage)
    (recipe,) = recipes(stage, sim)
    return stage, recipe


def box(stage: Usd.Stage) -> np.ndarray:
    """The 5th and 95th percentiles of the splats in the world, shape (2, 3)."""
    prim = stage.GetPrimAtPath("/World/Scan0")
    points = moved(world(prim), schema.fetch(prim).positions)
    return np.percentile(points, (5, 95), axis=0)


def test_a_preset_is_made_for_the_edited_capture(tmp_path) -> None:
    """Oracle: USD's composition of the same opinions; the ball passes through the moved middle."""
    made = capture(tmp_path)
    made.SetEditTarget(made.GetSessionLayer())
    UsdGeom.XformCommonAPI(made.GetPrimAtPath("/World")).SetTranslate((0, 7, 0))
    edits, low_high = made.GetSessionLayer(), box(made)
    plain, edited = Usd.Stage.Open(made.GetRootLayer()), tmp_path / "sim.usda"
    author_preset("push", plain, edited, edits=edits)
    stage = Usd.Stage.Open(str(edited))
    np.testing.assert_allclose(box(stage), low_high, rtol=1e-6)
    ball = stage.GetPrimAtPath("/World/Simulation/Ball")
    ends = [UsdGeom.XformCache(at).GetLocalToWorldTransform(ball) for at in (1, 100)]
    middle = np.mean([np.array(end.ExtractTranslation()) for end in ends], axis=0)
    np.testing.assert_allclose(middle, low_high.mean(axis=0), atol=1e-4)


def test_keys_of_edits_keep_their_second_at_another_rate(tmp_path) -> None:
    """Oracle: the same keys in the capture's own layer, which USD scales."""
    made = capture(tmp_path)
    made.SetTimeCodesPerSecond(48)
    edits = Sdf.Layer.CreateAnonymous(".usda")
    edits.timeCodesPerSecond = 48
    for layer, name in ((made.GetRootLayer(), "own"), (edits, "edit")):
        spec = Sdf.CreatePrimInLayer(layer, "/World")
        Sdf.AttributeSpec(spec, f"splat:{name}", Sdf.ValueTypeNames.Double)
        for time in (12.0, 48.0, 96.0):
            layer.SetTimeSample(f"/World.splat:{name}", time, 2.0 * time)
    made.Save()
    author_preset("push", made, tmp_path / "sim.usda", edits=edits)
    stage = Usd.Stage.Open(str(tmp_path / "sim.usda"))
    own, edit = (stage.GetAttributeAtPath(f"/World.splat:{name}") for name in ("own", "edit"))
    assert edit.GetTimeSamples() == own.GetTimeSamples() == [6.0, 24.0, 48.0]
    assert [edit.Get(time) for time in (6, 24, 48)] == [24.0, 96.0, 192.0]


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


def test_a_ball_goes_through_the_middle_of_the_capture(tmp_path) -> None:
    """Oracle: the capture's box: outside it first and last, in its middle half-way."""
    stage, recipe = written(tmp_path, "push")
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


def test_new_matter_covers_the_capture_by_the_last_frame(tmp_path) -> None:
    """Oracle: a front along the whole capture in less than the frames; lengths are in units of the
    field."""
    stage, recipe = written(tmp_path, "grow")
    asked = recipe.at(1).parameters
    assert asked.rd.enabled and asked.accretion.enabled and asked.accretion.style == "coral"
    size = np.ptp(box(stage), axis=0).max() / 2
    spacing = asked.carriers.spacing
    assert spacing >= 0.999 * size / 150
    along = size / (asked.rd.front_speed * spacing)
    assert along == pytest.approx(0.6 * 100 / 24, rel=1e-4)


def grown_on_a_sphere(folder: Path, splats: int) -> float:
    """The spacing of the carriers that grow has on a sphere of flat splats [unit]."""
    stage = Usd.Stage.CreateNew(str(folder / f"sphere{splats}.usdc"))
    at = np.random.default_rng(3).normal(size=(splats, 3)).astype(np.float32)
    at /= np.linalg.norm(at, axis=1)[:, None]
    x, y, z = at.T
    turned = np.stack([1 + z, -y, x, 0 * z], axis=1)  # from z to the normal
    turned /= np.linalg.norm(turned, axis=1)[:, None]
    flat = np.tile(np.float32([2, 2, 0.02]) / np.float32(np.sqrt(splats)), (splats, 1))
    discs = replace(cloud(0, n=splats), positions=at, scales=flat, rotations=turned)
    schema.author(stage, "/Sphere", discs)
    author_preset("grow", stage, folder / f"grow{splats}.usda")
    opened = Usd.Stage.Open(str(folder / f"grow{splats}.usda"))
    (recipe,) = recipes(opened, find_simulations(opened)[0])
    return recipe.at(1).parameters.carriers.spacing


@pytest.mark.parametrize(("splats", "carriers"), [(1000, 5000), (6000, 20_000)])
def test_a_capture_of_few_splats_grows_finer_than_they_are(splats, carriers, tmp_path) -> None:
    """Oracle: on the same surface, the number of carriers is as the inverse square of their
    spacing: 5 for each splat up to 20,000, relative to 25,000 splats with one carrier each."""
    few, many = grown_on_a_sphere(tmp_path, splats), grown_on_a_sphere(tmp_path, 25_000)
    assert (many / few) ** 2 == pytest.approx(carriers / 25_000, rel=0.1)


@pytest.mark.parametrize("style", STYLES)
def test_a_style_with_a_motif_needs_no_reaction(style, tmp_path) -> None:
    """Oracle: of 16,000 steps on 150 carriers, as many as there are of these carriers, and of
    100 frames a hundredth of that in each, with a pattern; one step, the least, with a motif."""
    author_preset("grow", capture(tmp_path), tmp_path / "sim.usda", options={"style": style})
    stage = Usd.Stage.Open(str(tmp_path / "sim.usda"))
    (recipe,) = recipes(stage, find_simulations(stage)[0])
    asked = recipe.at(1).parameters
    along = np.ptp(box(stage), axis=0).max() / 2 / asked.carriers.spacing
    assert along < 140
    assert asked.rd.substeps == (round(160 * along / 150) if style == "moss" else 1)


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_the_camera_of_wade_sees_the_figure(up, tmp_path) -> None:
    """Oracle: the camera's matrices: half-way, the middle of the torso is in the middle third of
    the picture, and the figure is more than half as high as it."""
    stage, _ = written(tmp_path, "wade", up)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Simulation/Camera")).GetCamera(38)
    frustum = camera.frustum
    seen = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    torso = stage.GetPrimAtPath("/World/Simulation/Figure/Torso")
    head = stage.GetPrimAtPath("/World/Simulation/Figure/Head")
    low, high = (seen.Transform(Gf.Vec3d(*world(each, 38.0)[:3, 3])) for each in (torso, head))
    assert abs(low[0]) < 0.33 and abs(low[1]) < 0.33
    assert high[1] - low[1] > 0.1 and high[1] < 1


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


@pytest.mark.parametrize("style", STYLES)
def test_the_style_of_grow_is_that_of_new_matter(style, tmp_path) -> None:
    """Oracle: the parameter on the stage."""
    author_preset("grow", capture(tmp_path), tmp_path / "a.usda", options={"style": style})
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    (sim,) = find_simulations(stage)
    assert sim.GetAttribute("splatSim:accretion:style").Get() == style


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_figure_walks_through_on_the_ground(up, tmp_path) -> None:
    """Oracle: the box of its shapes in USD: it is about 0.6 sizes high, walks farther than the
    capture is wide, and its legs swing both ways."""
    stage, recipe = written(tmp_path, "wade", up)
    figure = stage.GetPrimAtPath(f"{recipe.simulation.rpartition('/')[0]}/Figure")
    field = UsdGeom.Imageable(stage.GetPrimAtPath(recipe.path))
    points = recipe.rest.positions @ np.array(field.ComputeLocalToWorldTransform(1.0))[:3, :3]
    size = np.ptp(np.percentile(points, (5, 95), axis=0), axis=0).max()
    axis = "XYZ".index(up)

    def box(frame):
        cache = UsdGeom.BBoxCache(frame, [UsdGeom.Tokens.guide, UsdGeom.Tokens.default_])
        found = cache.ComputeWorldBound(figure).ComputeAlignedRange()
        return np.array([found.GetMin(), found.GetMax()])

    boxes = [box(frame) for frame in range(1, 76)]
    tall = boxes[0][1, axis] - boxes[0][0, axis]
    assert tall == pytest.approx(0.6 * size, rel=0.35)
    middles = np.array([each.mean(axis=0) for each in boxes])
    along = int(np.argmax(np.ptp(middles, axis=0)))
    assert along != axis
    assert np.ptp(middles[:, along]) > 1.2 * size
    leg = figure.GetStage().GetPrimAtPath(figure.GetPath().AppendPath("LeftLeg"))
    (turn,) = [op for op in UsdGeom.Xform(leg).GetOrderedXformOps() if "rotate" in op.GetName()]
    angles = [turn.Get(frame) for frame in turn.GetTimeSamples()]
    assert min(angles) < -20 and max(angles) > 20


def test_materials_are_those_of_matter(tmp_path) -> None:
    """Oracle: the attributes: what falls has gravity downwards and a ground."""
    for number, (name, given) in enumerate((("push", "jelly"), ("shatter", None), ("wade", None))):
        folder = tmp_path / str(number)
        folder.mkdir()
        target = folder / "sim.usda"
        author_preset(name, capture(folder), target, options={"material": given})
        stage = Usd.Stage.Open(str(target))
        (sim,) = find_simulations(stage)
        values = {each.GetName(): each.Get() for each in sim.GetAuthoredAttributes()}
        expected = given or {"shatter": "stone", "wade": "foliage"}[name]
        assert values["splatSim:matter:material"] == expected
        falls = name == "shatter"
        assert ("splatSim:particles:gravity" in values) == falls
        if falls:
            assert values["splatSim:particles:gravity"][1] < 0
            assert values["splatSim:matter:ground"] is True


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

    with pytest.raises(UsageError, match="--style: found 'wool', expected one of cells, coral, "):
        asked("grow", style="wool")
    with pytest.raises(UsageError, match=r"--material: found 'clay' and --preset grow, .* --style"):
        asked("grow", material="clay")
    with pytest.raises(UsageError, match=r"--style: .* --preset dissolve, .*takes no option"):
        asked("dissolve", style="x")
    assert not (tmp_path / "a.usda").exists()


def test_what_cannot_be_a_preset_is_one_sentence(tmp_path) -> None:
    """Oracle: the sentences; a failure leaves nothing behind."""
    stage = capture(tmp_path)
    with pytest.raises(UsageError, match="preset: found 'melt', expected one of grow, push, wade"):
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


@pytest.mark.parametrize(("up", "own"), [("Y", "Z"), ("Y", "Y"), ("Z", "Y")])
def test_meshes_stand_where_the_capture_stands(up, own, tmp_path) -> None:
    """Oracle: the box of both cubes: upright, half as large again as the capture, on its bottom."""
    stage = capture(tmp_path, up=up)
    author_preset("conform", stage, tmp_path / "sim.usda", goal=block(tmp_path, own))
    made = Usd.Stage.Open(str(tmp_path / "sim.usda"))
    (recipe,) = recipes(made, find_simulations(made)[0])
    low, high = box(made)
    target = recipe.at(1).target
    assert target is not None
    points = moved(recipe.at(1).to_world, target.points)
    axis = "XYZ".index(up)
    tall = 1.5 * (high - low).max()
    extent = np.ptp(points, axis=0)
    assert extent[axis] == pytest.approx(tall, rel=1e-4)
    assert sorted(extent) == pytest.approx([2 / 9 * tall, 3 / 9 * tall, tall], rel=1e-4)
    assert points[:, axis].min() == pytest.approx(low[axis], abs=1e-4)
    middle = np.delete((points.min(axis=0) + points.max(axis=0)) / 2 - (low + high) / 2, axis)
    np.testing.assert_allclose(middle, 0, atol=1e-4)
    a, b, c = (points[target.triangles[:, i]] for i in range(3))
    volume = np.einsum("ti,ti->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(54 * (tall / 9) ** 3, rel=1e-3), "they face outwards"
    holder = UsdGeom.Imageable(made.GetPrimAtPath("/World/Simulation/Target"))
    assert holder.ComputePurpose() == "guide", "pictures do not show it"
    references = made.GetRootLayer().GetPrimAtPath("/World/Simulation/Target/Content")
    (path,) = references.referenceList.prependedItems
    assert path.assetPath == "./block.usda"


def test_a_capture_to_become_is_as_large_as_the_capture(tmp_path) -> None:
    """Oracle: the boxes of both captures."""
    stage, recipe = written(tmp_path, "morph")
    becomes = recipe.at(1).becomes
    assert becomes is not None and len(becomes) == 300
    assert recipe.rest.sh.shape[1] >= becomes.sh.shape[1]
    points = moved(recipe.at(1).to_world, becomes.positions)
    low, high = box(stage)
    there = np.percentile(points, (5, 95), axis=0)
    assert np.ptp(there, axis=0).max() == pytest.approx((high - low).max(), rel=0.15)
    assert recipe.at(1).target is None


def test_targets_that_do_not_fit_are_one_sentence(tmp_path) -> None:
    """Oracle: the sentences."""
    stage, into = capture(tmp_path), tmp_path / "a.usda"
    with pytest.raises(
        UsageError, match=r"--target: .*other.usdc' and --preset push, expected non"
    ):
        author_preset("push", stage, into, goal=other(tmp_path))
    with pytest.raises(UsageError, match="--target: found none and --preset morph, expected a cap"):
        author_preset("morph", stage, into)
    solid = block(tmp_path)
    with pytest.raises(StageError, match="found meshes, expected a capture"):
        author_preset("morph", stage, into, goal=solid)
    with pytest.raises(StageError, match="found a capture, expected meshes"):
        author_preset("conform", stage, into, goal=Usd.Stage.Open(str(tmp_path / "other.usdc")))
    empty = Usd.Stage.CreateNew(str(tmp_path / "empty.usda"))
    empty.SetDefaultPrim(empty.DefinePrim("/Empty"))
    empty.Save()
    with pytest.raises(StageError, match="found 0 splat fields and 0 meshes, expected meshes, or"):
        author_preset("conform", stage, into, goal=empty)
    assert not into.exists()
