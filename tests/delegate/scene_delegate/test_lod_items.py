"""Tests of the items of LOD roots in pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.schema.clouds import cloud
from tests.trees import little_tree
from usdsplat import schema
from usdsplat.core.lod_heuristics import LodHeuristic
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate.lod_items import lod_view
from usdsplat.render.specs import View
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.lod_root_authoring import author_lod_root

UsdLod = pytest.importorskip("pxr.UsdLod", reason="USD has UsdLod since 26.8")

SIZE = (48, 32)
NEAR, FAR = "/Near", "/Far"


def camera(stage: Usd.Stage, path: str, distance: float) -> None:
    """Define a camera on the z axis."""
    made = UsdGeom.Camera.Define(stage, path)
    made.AddTranslateOp().Set(Gf.Vec3d(0, 0, distance))
    made.CreateClippingRangeAttr(Gf.Vec2f(0.1, 1000))


def meshes(*, only: str = "", invisible: str = "") -> Usd.Stage:
    """A root with a cube and a sphere; `only` leaves out the root and all items but one."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    camera(stage, NEAR, 4)
    camera(stage, FAR, 60)
    root = UsdGeom.Xform.Define(stage, "/Set/Rock").GetPrim()
    if only in ("", "high"):
        UsdGeom.Cube.Define(stage, "/Set/Rock/high")
    if only in ("", "low"):
        UsdGeom.Sphere.Define(stage, "/Set/Rock/low")
    if only:
        return stage
    if invisible:
        UsdGeom.Imageable(stage.GetPrimAtPath(f"/Set/Rock/{invisible}")).MakeInvisible()
    api = UsdLod.RootAPI.Apply(root)
    size = UsdLod.ScreenSizeHeuristic.Define(stage, "/Set/Size")
    size.CreateLodDomainAttr("imaging")
    size.CreateThresholdsAttr([0.05])
    size.CreateExtentAttr([(-1, -1, -1), (1, 1, 1)])
    api.CreateLodHeuristicsRel().SetTargets(["/Set/Size"])
    return stage


def picture(engine: Engine, path: str) -> np.ndarray:
    """The depth of a picture: a cube and a sphere differ in it."""
    return engine.picture(engine.view(path, resolution=SIZE), aovs=("depth",))["depth"].copy()


def drawn(stage: Usd.Stage, path: str) -> np.ndarray:
    """The picture of a new engine."""
    with Engine(stage, device="cpu") as engine:
        return picture(engine, path)


def same(first: np.ndarray, second: np.ndarray) -> None:
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("invisible", ["", "low"])
def test_a_picture_has_the_item_of_its_view(invisible: str) -> None:
    """Oracle: stages with one item and no root, near and far; an item that is invisible in
    renderers without UsdLod is drawn when it is chosen."""
    same(drawn(meshes(invisible=invisible), NEAR), drawn(meshes(only="high"), NEAR))
    same(drawn(meshes(invisible=invisible), FAR), drawn(meshes(only="low"), FAR))
    assert not np.array_equal(drawn(meshes(only="high"), FAR), drawn(meshes(only="low"), FAR))


def test_views_in_turn_do_not_disturb_each_other() -> None:
    """Oracle: the same views, each in an engine of its own."""
    expected = {path: drawn(meshes(), path) for path in (NEAR, FAR)}
    with Engine(meshes(), device="cpu") as engine:
        for path in (NEAR, FAR, FAR, NEAR, FAR):
            same(picture(engine, path), expected[path])


def test_a_still_view_reads_nothing_again() -> None:
    """Oracle: the counts of reads, and the version of the scene."""
    with Engine(meshes(), device="cpu") as engine:
        picture(engine, FAR)
        before, version = engine.pulls, engine.version
        picture(engine, FAR)
        assert (engine.pulls, engine.version) == (before, version)


def test_overrides_are_obeyed_when_they_are_edited() -> None:
    """Oracle: stages with one item; none is drawn with noLOD."""
    stage = meshes()
    with Engine(stage, device="cpu") as engine:
        same(picture(engine, NEAR), drawn(meshes(only="high"), NEAR))
        override = UsdLod.OverrideAPI.Apply(stage.GetPrimAtPath("/Set"))
        override.CreateLodOverrideModeAttr("indexedLOD")
        override.CreateLodOverrideIndexAttr(1.0)
        same(picture(engine, NEAR), drawn(meshes(only="low"), NEAR))
        override.GetLodOverrideIndexAttr().Set(0.0)
        same(picture(engine, NEAR), drawn(meshes(only="high"), NEAR))
        override.GetLodOverrideModeAttr().Set("noLOD")
        assert not np.isfinite(picture(engine, NEAR)).any()
        override.GetLodOverrideModeAttr().Set("allLOD")
        both = np.fmin(drawn(meshes(only="high"), NEAR), drawn(meshes(only="low"), NEAR))
        same(picture(engine, NEAR), both)
        stage.GetPrimAtPath("/Set/Rock").RemoveAppliedSchema("LODRootAPI")
        same(picture(engine, NEAR), both)


def test_an_animated_override_is_that_of_the_frame() -> None:
    """Oracle: stages with one item."""
    stage = meshes()
    override = UsdLod.OverrideAPI.Apply(stage.GetPrimAtPath("/Set/Rock"))
    override.CreateLodOverrideModeAttr("indexedLOD")
    index = override.CreateLodOverrideIndexAttr()
    index.Set(0.0, 1)
    index.Set(1.0, 10)
    with Engine(stage, device="cpu", time=1) as engine:
        for time, item in ((1, "high"), (10, "low"), (2, "high")):
            engine.set_time(time)
            same(picture(engine, NEAR), drawn(meshes(only=item), NEAR))


def test_each_native_instance_has_its_own_item() -> None:
    """Oracle: the paths of the drawn prims: a near instance and a far one of one root."""
    stage = meshes()
    shot = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(shot, "Y")
    camera(shot, NEAR, 4)
    for name, z in (("A", 0), ("B", -60)):
        prim = UsdGeom.Xform.Define(shot, f"/{name}")
        prim.AddTranslateOp().Set(Gf.Vec3d(0, 0, z))
        prim.GetPrim().GetReferences().AddReference(stage.GetRootLayer().identifier, "/Set")
        prim.GetPrim().SetInstanceable(True)
    with Engine(shot, device="cpu") as engine:
        picture(engine, NEAR)
        assert engine.drawn_paths() == ("/A/Rock/high", "/B/Rock/low")


def test_a_hidden_root_hides_its_items() -> None:
    """Oracle: USD's rule: what is invisible hides all below."""
    stage = meshes()
    UsdGeom.Imageable(stage.GetPrimAtPath("/Set/Rock")).MakeInvisible()
    assert not np.isfinite(drawn(stage, NEAR)).any()


def test_items_that_a_tree_stands_for_are_not_drawn(tmp_path: Path) -> None:
    """Oracle: the paths of the drawn prims, before and after the tree names the root."""
    stage = Usd.Stage.Open(str(little_tree(tmp_path, cloud(n=64, degree=0))))
    coarse = [cloud(n=8, degree=0), cloud(n=4, degree=0)]
    root = author_lod_root(
        stage, "/tree/coarse", coarse, thresholds=(0.01,), drawing=DrawingHints()
    )
    with Engine(stage, device="cpu") as engine:
        assert "/tree/coarse/lod0" in engine.drawn_paths()
        tree = stage.GetPrimAtPath("/tree/splats")
        relationship = tree.CreateRelationship("splat:lod:root", custom=False)
        relationship.SetTargets([root.GetPath()])
        assert not [path for path in engine.drawn_paths() if path.startswith("/tree/coarse")]
        relationship.ClearTargets(True)
        assert "/tree/coarse/lod0" in engine.drawn_paths()


def test_a_root_that_cannot_be_read_is_one_finding() -> None:
    """Oracle: an index of another type; all visible items are drawn."""
    stage = meshes()
    stage.GetRootLayer().GetPrimAtPath("/Set/Rock")
    prim = stage.GetRootLayer().GetPrimAtPath("/Set/Rock")
    Sdf.AttributeSpec(prim, "lod:default:index", Sdf.ValueTypeNames.String).default = "one"
    with Engine(stage, device="cpu") as engine:
        (found,) = [each for each in engine.findings if each.code == "bad-lod-root"]
        assert (found.path, found.attribute) == ("/Set/Rock", "lod:default:index")
        assert engine.drawn_paths() == ("/Set/Rock/high", "/Set/Rock/low")


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_view_is_the_frustum_of_its_camera(orthographic: bool) -> None:
    """Oracle: UsdLod's query with the frustum that UsdGeom computes for the camera."""
    stage = Usd.Stage.CreateInMemory()
    made = UsdGeom.Camera.Define(stage, "/Camera")
    if orthographic:
        made.CreateProjectionAttr("orthographic")
    made.AddTranslateOp().Set(Gf.Vec3d(3, 2, 14))
    made.AddRotateXYZOp().Set(Gf.Vec3f(-8, 12, 5))
    made.CreateHorizontalApertureOffsetAttr(1.5)
    made.CreateVerticalApertureOffsetAttr(-1)
    if orthographic:
        made.CreateHorizontalApertureAttr(120)
        made.CreateVerticalApertureAttr(80)
    made.CreateClippingRangeAttr(Gf.Vec2f(1, 300))
    theirs = made.GetCamera(Usd.TimeCode.Default())
    columns, rows = 300, round(300 / theirs.aspectRatio)
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(columns, rows))
    assert isinstance(view, View)
    box = Gf.Range3d(Gf.Vec3d(-1, -2, -1), Gf.Vec3d(2, 1, 1))
    for method, metric in (("projectedSphere", "sphere"), ("projectedExtent", "box")):
        query = UsdLod.ScreenSizeHeuristicQuery("imaging", box, method, [], [])
        size = query.ComputeScreenSize(theirs.frustum, Gf.Matrix4d(1))
        assert 0.001 < size < 1
        for factor, level in ((0.98, 0), (1.02, 1)):
            ours = LodHeuristic(
                metric=metric, low=(-1, -2, -1), high=(2, 1, 1), thresholds=(size * factor,)
            )
            assert ours.level(lod_view(view), np.eye(4)) == level


def test_a_field_of_a_root_is_drawn_like_any_other() -> None:
    """Oracle: a stage with that field alone."""
    stage, alone = Usd.Stage.CreateInMemory(), Usd.Stage.CreateInMemory()
    fields = [cloud(n=40, degree=1), cloud(seed=1, n=10, degree=1)]
    author_lod_root(stage, "/Root", fields, thresholds=(1e-9,), drawing=DrawingHints())
    schema.author(alone, "/Root/lod0", fields[0])
    pictures = []
    for each in (stage, alone):
        camera(each, NEAR, 9)
        with Engine(each, device="cpu") as engine:
            pictures.append(engine.picture(engine.view(NEAR, resolution=SIZE))["color"].copy())
    same(*pictures)


def edits(stage: Usd.Stage) -> list[Callable[[np.random.Generator], object]]:
    """Edits that change which items are drawn, or what a choice is made of."""
    root = UsdGeom.Xform(stage.GetPrimAtPath("/Set/Rock"))
    size = UsdLod.ScreenSizeHeuristic(stage.GetPrimAtPath("/Set/Size"))
    parent = stage.GetPrimAtPath("/Set")
    move = root.AddTranslateOp()
    names = Sdf.ValueTypeNames

    def override(prim: Usd.Prim, rng: np.random.Generator) -> None:
        prim.AddAppliedSchema("LODOverrideAPI")
        modes = ("inherited", "noOverride", "indexedLOD", "noLOD", "allLOD")
        prim.CreateAttribute("lod:override:mode", names.Token).Set(modes[rng.integers(5)])
        prim.CreateAttribute("lod:override:index", names.Float).Set(float(rng.integers(3)))

    def seen(rng: np.random.Generator) -> None:
        paths = ("/Set/Rock", "/Set/Rock/high", "/Set/Rock/low")
        value = ("inherited", "invisible")[rng.integers(2)]
        UsdGeom.Imageable(stage.GetPrimAtPath(paths[rng.integers(3)])).CreateVisibilityAttr(value)

    def item(rng: np.random.Generator) -> None:
        if stage.GetPrimAtPath("/Set/Rock/more"):
            stage.RemovePrim("/Set/Rock/more")
        else:
            UsdGeom.Cone.Define(stage, "/Set/Rock/more")

    def apply(rng: np.random.Generator) -> None:
        change = root.GetPrim().AddAppliedSchema
        if rng.random() < 0.3:
            change = root.GetPrim().RemoveAppliedSchema
        change("LODRootAPI")

    return [
        lambda rng: override(parent, rng),
        lambda rng: override(root.GetPrim(), rng),
        lambda rng: parent.RemoveAppliedSchema("LODOverrideAPI"),
        lambda rng: size.CreateThresholdsAttr([float(rng.uniform(0.0001, 0.5))]),
        lambda rng: size.CreateBlendThresholdsAttr([float(rng.uniform(0.0001, 0.5))]),
        lambda rng: size.CreateProjectionMethodAttr(
            ("projectedSphere", "projectedExtent")[rng.integers(2)]
        ),
        lambda rng: size.CreateLodDomainAttr(("imaging", "audio")[rng.integers(2)]),
        lambda rng: size.CreateExtentAttr([(-1, -1, -1), (1, 1, float(rng.uniform(1, 9)))]),
        lambda rng: move.Set(Gf.Vec3d(*rng.uniform(-1, 1, 2), rng.uniform(-60, 0))),
        lambda rng: (
            root.GetPrim()
            .CreateAttribute("lod:default:index", names.Int)
            .Set(int(rng.integers(-1, 4)))
        ),
        seen,
        item,
        apply,
    ]


@pytest.mark.parametrize("seed", range(3))
def test_random_edits_give_the_picture_of_a_new_engine(seed: int) -> None:
    """Oracle: an engine that reads the edited stage anew; bit for bit."""
    rng = np.random.default_rng(seed)
    stage = meshes()
    known = edits(stage)
    pictures = set()
    with Engine(stage, device="cpu") as engine:
        for _ in range(25):
            for _ in range(rng.integers(1, 3)):
                known[rng.integers(len(known))](rng)
            path = (NEAR, FAR)[rng.integers(2)]
            found = picture(engine, path)
            same(found, drawn(stage, path))
            pictures.add(found.tobytes())
    assert len(pictures) > 4
