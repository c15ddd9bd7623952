"""Tests of reading and writing LOD roots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation, Vt

from tests.schema.clouds import cloud
from tests.trees import little_tree
from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.lod_heuristics import LodView
from usdsplat.schema import lod_root_authoring, lod_roots
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.lod_root_authoring import author_lod_root
from usdsplat.schema.lod_roots import (
    is_lod_root,
    read_lod_root,
    tree_level,
)

UsdLod = pytest.importorskip("pxr.UsdLod", reason="USD has UsdLod since 26.8")

FIELDS = [cloud(n=40, degree=1), cloud(seed=1, n=10, degree=1), cloud(seed=2, n=4, degree=0)]
NOW = Usd.TimeCode.Default()
CLASSIC = DrawingHints(rasterize_mode="antialiased")


def authored(stage: Usd.Stage, **options: Any) -> Usd.Prim:
    """A root of three fields."""
    stage.SetDefaultPrim(stage.DefinePrim("/City", "Xform"))
    given = {"thresholds": (0.25, 0.05), "drawing": CLASSIC}
    return author_lod_root(stage, "/City/coarse", FIELDS, **{**given, **options})


def view_at(distance: float) -> LodView:
    """A camera on the z axis with a picture as wide as its distance."""
    return LodView(eye=(0, 0, distance), window=(1, 1), to_clip=np.eye(4))


def test_what_is_authored_is_what_usdlod_reads(stage: Usd.Stage) -> None:
    """Oracle: UsdLod's own API schemas and heuristic."""
    root = authored(stage, default=1)
    api = UsdLod.RootAPI(root)
    assert api and root.HasAPI(UsdLod.RootAPI)
    assert api.GetLodDefaultIndexAttr().Get() == 1
    (target,) = api.GetLodHeuristicsRel().GetTargets()
    assert not target.HasPrefix(root.GetPath())  # children are items
    heuristic = UsdLod.ScreenSizeHeuristic(stage.GetPrimAtPath(target))
    assert heuristic.GetLodDomainAttr().Get() == "imaging"
    assert list(heuristic.GetThresholdsAttr().Get()) == pytest.approx([0.25, 0.05])
    assert [child.GetName() for child in root.GetChildren()] == ["lod0", "lod1", "lod2"]
    for prim in (root, stage.GetPrimAtPath(target)):
        for prop in prim.GetAuthoredProperties():
            assert prim.GetPrimDefinition().GetPropertyDefinition(prop.GetName()), prop


def test_the_items_are_stock_fields_of_which_one_is_visible(stage: Usd.Stage) -> None:
    """Oracle: what `fetch` and UsdGeom read; a renderer without UsdLod draws visible children."""
    root = authored(stage, default=1)
    for prim, splats, visible in zip(root.GetChildren(), FIELDS, (False, True, False), strict=True):
        assert prim.GetTypeName() == "ParticleField3DGaussianSplat"
        np.testing.assert_array_equal(schema.fetch(prim).positions, splats.positions)
        assert schema.rasterize_mode(prim) == "antialiased"
        assert (UsdGeom.Imageable(prim).ComputeVisibility() == "inherited") == visible


def test_usds_validators_find_nothing(tmp_path: Path) -> None:
    """Oracle: all validators of USD, on a file with a root beside a tree."""
    path = little_tree(tmp_path, cloud(n=64, degree=1))
    stage = Usd.Stage.Open(str(path))
    tree = stage.GetPrimAtPath("/tree/splats")
    author_lod_root(
        stage, "/tree/coarse", FIELDS, thresholds=(0.2, 0.1), drawing=CLASSIC, tree=tree
    )
    registry = UsdValidation.ValidationRegistry()
    names = [meta.name for meta in registry.GetAllValidatorMetadata()]
    chosen = [name for name in names if name.startswith(("usdGeom", "usdLod", "usdCore", "usd:"))]
    assert chosen
    validators = registry.GetOrLoadValidatorsByName(chosen)
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in errors] == []
    assert tree.GetRelationship("splat:lod:root").GetTargets() == ["/tree/coarse"]
    assert schema.validate(stage) == []


def test_a_root_is_chosen_by_the_size_of_all_its_fields(stage: Usd.Stage) -> None:
    """Oracle: UsdLod's query of the same heuristic, near and far."""
    root = authored(stage)
    (target,) = root.GetRelationship("lod:heuristics").GetTargets()
    heuristic = UsdLod.ScreenSizeHeuristic(stage.GetPrimAtPath(target))
    boxes = [schema.compute_extent(each) for each in FIELDS]
    low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    np.testing.assert_array_equal(heuristic.GetExtentAttr().Get(), [low, high])
    seen = set()
    for distance in np.geomspace(5, 500, 30):
        frustum = Gf.Frustum(Gf.Matrix4d().SetTranslate((0, 0, distance)),
                             Gf.Range2d((-0.5, -0.5), (0.5, 0.5)), Gf.Range1d(0.1, 1e4),
                             Gf.Frustum.Perspective)  # fmt: skip
        query = heuristic.CreateScreenSizeHeuristicQuery()
        expected = query.ComputeLOD(query.ComputeScreenSize(frustum, Gf.Matrix4d(1)))
        (shown,) = read_lod_root(root, NOW).shown(view_at(distance))
        assert shown == f"/City/coarse/lod{expected:g}"
        seen.add(shown)
    assert len(seen) == 3


def test_without_a_view_the_default_is_chosen(stage: Usd.Stage) -> None:
    """Oracle: `lod:default:index`, clamped to the items."""
    root = authored(stage, default=2)
    assert read_lod_root(root, NOW).shown() == ("/City/coarse/lod2",)
    root.GetAttribute("lod:default:index").Set(99)
    assert read_lod_root(root, NOW).shown() == ("/City/coarse/lod2",)
    root.GetAttribute("lod:default:index").Set(-1)
    assert read_lod_root(root, NOW).shown() == ("/City/coarse/lod0",)


@pytest.mark.parametrize(
    ("mode", "index", "shown"),
    [
        ("indexedLOD", 1.0, ["lod1"]),
        ("indexedLOD", 1.6, ["lod2"]),
        ("indexedLOD", -4.0, ["lod0"]),
        ("noLOD", 0.0, []),
        ("allLOD", 0.0, ["lod0", "lod1", "lod2"]),
        ("noOverride", 1.0, ["lod0"]),
        ("inherited", 1.0, ["lod0"]),
        ("nonsense", 1.0, ["lod0"]),
    ],
)
@pytest.mark.parametrize("where", ["/City/coarse", "/City"])
def test_an_override_at_or_above_decides(
    stage: Usd.Stage, where: str, mode: str, index: float, shown: list[str]
) -> None:
    """Oracle: the documentation of LODOverrideAPI, and its mode as UsdLod computes it."""
    root = authored(stage)
    override = UsdLod.OverrideAPI.Apply(stage.GetPrimAtPath(where))
    override.CreateLodOverrideModeAttr(mode)
    override.CreateLodOverrideIndexAttr(index)
    paths = tuple(f"/City/coarse/{name}" for name in shown)
    assert read_lod_root(root, NOW).shown(view_at(0.001)) == paths
    theirs, number = UsdLod.OverrideAPI(root).ComputeLODOverride()
    ours = read_lod_root(root, NOW)
    assert theirs in (ours.mode, "inherited", "nonsense")
    assert mode != "indexedLOD" or ours.index == pytest.approx(number)


def test_an_override_below_hides_one_above(stage: Usd.Stage) -> None:
    """Oracle: the nearest override that is not inherited, as UsdLod computes it."""
    root = authored(stage)
    UsdLod.OverrideAPI.Apply(stage.GetPrimAtPath("/City")).CreateLodOverrideModeAttr("noLOD")
    UsdLod.OverrideAPI.Apply(root).CreateLodOverrideModeAttr("noOverride")
    assert UsdLod.OverrideAPI(root).ComputeLODOverride()[0] == "noOverride"
    assert len(read_lod_root(root, NOW).shown()) == 1


def test_roots_of_others_are_read(stage: Usd.Stage) -> None:
    """Oracle: a root of meshes with a heuristic of another domain, one by distance, and one by the
    bounding volume of a prim."""
    root = stage.DefinePrim("/Tree", "Xform")
    UsdLod.RootAPI.Apply(root)
    for name in ("high", "low"):
        UsdGeom.Mesh.Define(stage, f"/Tree/{name}")
    sound = UsdLod.DistanceHeuristic.Define(stage, "/Sound")
    sound.CreateLodDomainAttr("audio")
    distance = UsdLod.DistanceHeuristic.Define(stage, "/Distance")
    distance.CreateLodDomainAttr("imaging")
    distance.CreateThresholdsAttr([10.0])
    distance.CreateCenterAttr((0, 0, 5))
    UsdLod.RootAPI(root).CreateLodHeuristicsRel().SetTargets(["/Gone", "/Sound", "/Distance"])
    for z, name in ((14.9, "high"), (15.1, "low")):
        assert read_lod_root(root, NOW).shown(view_at(z)) == (f"/Tree/{name}",)
    cube = UsdGeom.Cube.Define(stage, "/Cube")
    cube.CreateExtentAttr([(-1, -1, -1), (1, 1, 20)])
    distance.CreateBoundingVolumeRel().SetTargets(["/Cube"])
    for z, name in ((29.9, "high"), (30.1, "low")):
        assert read_lod_root(root, NOW).shown(view_at(z)) == (f"/Tree/{name}",)


def test_schemas_that_usd_does_not_know_are_read_by_name(
    stage: Usd.Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: names that are in no registry, as those of UsdLod are before 26.8."""
    for name in ("ROOT_API", "OVERRIDE_API", "SCREEN_SIZE"):
        unknown = f"Unknown{getattr(lod_roots, name)}"
        for module in (lod_roots, lod_root_authoring):
            monkeypatch.setattr(module, name, unknown, raising=module is lod_roots)
        registry = Usd.SchemaRegistry()
        assert not registry.FindAppliedAPIPrimDefinition(unknown)
        assert not registry.FindConcretePrimDefinition(unknown)
    root = authored(stage)
    assert is_lod_root(root) and root.GetAppliedSchemas() == []
    assert read_lod_root(root, NOW).shown(view_at(5)) == ("/City/coarse/lod0",)
    assert read_lod_root(root, NOW).shown(view_at(5000)) == ("/City/coarse/lod2",)
    root.AddAppliedSchema("UnknownLODOverrideAPI")
    root.CreateAttribute("lod:override:mode", Sdf.ValueTypeNames.Token).Set("noLOD")
    assert read_lod_root(root, NOW).shown(view_at(5)) == ()


def test_a_root_without_items_shows_nothing(stage: Usd.Stage) -> None:
    """Oracle: it has no children."""
    root = stage.DefinePrim("/Tree", "Xform")
    UsdLod.RootAPI.Apply(root)
    assert is_lod_root(root) and read_lod_root(root, NOW).shown() == ()


def test_other_prims_and_types_are_one_sentence(stage: Usd.Stage) -> None:
    """Oracle: a prim without the API, and attributes of other types that USD lets pass."""
    with pytest.raises(StageError, match="found no LODRootAPI"):
        read_lod_root(stage.DefinePrim("/Other"), NOW)
    authored(stage)
    layer = stage.GetRootLayer()
    heuristic = layer.GetPrimAtPath("/City/coarse_heuristic")
    for path, value, said in (
        ("/City/coarse.lod:default:index", "one", "lod:default:index: found 'one', expected a num"),
        ("/City/coarse_heuristic.extent", Vt.IntArray(4), "extent: found an array of shape"),
    ):
        prim = layer.GetPrimAtPath(Sdf.Path(path).GetPrimPath())
        name = Sdf.Path(path).name
        before = prim.properties[name].default
        prim.RemoveProperty(prim.properties[name])
        kind = Sdf.GetValueTypeNameForValue(value)
        Sdf.AttributeSpec(prim, name, kind).default = value
        with pytest.raises(StageError, match=said):
            read_lod_root(stage.GetPrimAtPath("/City/coarse"), NOW)
        prim.RemoveProperty(prim.properties[name])
        Sdf.AttributeSpec(prim, name, Sdf.GetValueTypeNameForValue(before)).default = before
    assert heuristic and read_lod_root(stage.GetPrimAtPath("/City/coarse"), NOW)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"thresholds": (0.2,)}, "thresholds: found"),
        ({"thresholds": (0.1, 0.2)}, "expected 2 descending fractions above 0"),
        ({"thresholds": (0.1, float("nan"))}, "thresholds: found"),
        ({"default": 3}, "default: found 3, expected 0 to 2"),
    ],
)
def test_nothing_is_written_for_invalid_arguments(
    stage: Usd.Stage, options: dict[str, Any], said: str
) -> None:
    """Oracle: the stage, which has no root."""
    with pytest.raises(UsageError, match=said):
        authored(stage, **options)
    assert not stage.GetPrimAtPath("/City/coarse")
    with pytest.raises(UsageError, match="fields: found none"):
        author_lod_root(stage, "/City/coarse", [], thresholds=(), drawing=CLASSIC)
    below = stage.DefinePrim("/City/coarse/tree")
    with pytest.raises(UsageError, match="below the root, expected a prim beside it"):
        authored(stage, tree=below)


@pytest.mark.parametrize(
    ("mode", "index", "level"),
    [
        ("noOverride", 2.0, None),
        ("indexedLOD", 2.0, 2),
        ("indexedLOD", 0.6, 1),
        ("indexedLOD", -1.0, 0),
        ("allLOD", 2.0, 0),
        ("noLOD", 2.0, 0),
    ],
)
@pytest.mark.parametrize("where", ["/tree/coarse", "/tree"])
def test_an_override_is_a_level_of_the_tree(
    tmp_path: Path, where: str, mode: str, index: float, level: int | None
) -> None:
    """Oracle: our documentation of LODOverrideAPI on trees; the override is at the root, or above
    both."""
    stage = Usd.Stage.Open(str(little_tree(tmp_path, cloud(n=64, degree=1))))
    tree = stage.GetPrimAtPath("/tree/splats")
    assert tree_level(tree, NOW) is None
    options = {"thresholds": (0.2, 0.1), "drawing": CLASSIC, "tree": tree}
    author_lod_root(stage, "/tree/coarse", FIELDS, **options)
    override = UsdLod.OverrideAPI.Apply(stage.GetPrimAtPath(where))
    override.CreateLodOverrideModeAttr(mode)
    override.CreateLodOverrideIndexAttr(index)
    assert tree_level(tree, NOW) == level


def in_every_instance(stage: Usd.Stage) -> tuple[list[Sdf.Path], set[Sdf.Path]]:
    """The LOD roots of a stage and those that trees name, by a walk of all instance proxies."""
    roots, named = [], set()
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if is_lod_root(prim):
            roots.append(prim.GetPath())
        elif prim.GetTypeName() == schema.tokens.TREE_TYPE:
            named.update(prim.GetRelationship("splat:lod:root").GetForwardedTargets())
    return roots, named


@pytest.mark.parametrize("seed", range(8))
def test_roots_are_found_in_nested_instances(tmp_path: Path, seed: int) -> None:
    """Oracle: a walk of every prim in every instance, on random stages: instances in instances,
    inactive, abstract and undefined prims."""
    rng = np.random.default_rng(seed)
    tree = str(little_tree(tmp_path, cloud(n=64, degree=1)))
    asset = Sdf.Layer.CreateNew(str(tmp_path / "asset.usda"))
    stage = Usd.Stage.Open(asset)
    for level in range(4):
        for number in range(5):
            path = f"/Kind{level}/P{number}"
            prim = stage.OverridePrim(path)
            prim.SetSpecifier(rng.choice([Sdf.SpecifierDef] * 5 + [Sdf.SpecifierOver]))
            prim.SetTypeName("Xform")
            what = rng.integers(5)
            if what == 0:
                prim.AddAppliedSchema("LODRootAPI")
            elif what == 1:
                prim.GetReferences().AddReference(tree)
                stage.GetPrimAtPath(f"{path}/splats").CreateRelationship(
                    "splat:lod:root"
                ).SetTargets([f"/Kind{level}/P0"])
            elif level and what < 4:
                prim.GetReferences().AddInternalReference(f"/Kind{level - 1}")
                prim.SetInstanceable(True)
            prim.SetActive(bool(rng.random() < 0.9))
        stage.GetPrimAtPath(f"/Kind{level}").SetSpecifier(Sdf.SpecifierDef)
    asset.Save()
    shot = Usd.Stage.CreateInMemory()
    for number in range(6):
        prim = shot.DefinePrim(f"/World/I{number}", "Xform")
        prim.GetReferences().AddReference(asset.identifier, f"/Kind{3 - number % 2}")
        prim.SetInstanceable(number < 4)
    roots, named = in_every_instance(shot)
    found = lod_roots.find_roots(shot)
    assert [prim.GetPath() for prim in found.prims] == roots
    assert found.replaced == named
    assert any(prim.IsInstanceProxy() for prim in found.prims) or not roots
