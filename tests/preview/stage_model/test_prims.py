"""Tests of the rows of the prim tree, and of its search."""

from __future__ import annotations

import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.preview.stage_model.stages import rich
from usdsplat.core.errors import StageError
from usdsplat.preview.stage_model.prims import PrimRow, children, search


def row(stage: Usd.Stage, path: str, *, time: float | None = None) -> PrimRow:
    """The row of a prim, among those of its parent's children."""
    rows = children(stage, str(Sdf.Path(path).GetParentPath()), time=time)
    return next(each for each in rows if each.path == path)


def many(count: int) -> Usd.Stage:
    """Spheres, two hundred to a group."""
    stage = Usd.Stage.CreateInMemory()
    layer = stage.GetRootLayer()
    with Sdf.ChangeBlock():
        for number in range(count):
            path = Sdf.Path(f"/Group{number // 200}/Ball{number}")
            for each in path.GetPrefixes():
                Sdf.CreatePrimInLayer(layer, each).specifier = Sdf.SpecifierDef
            layer.GetPrimAtPath(path).typeName = "Sphere"
    return stage


def names(rows):
    return [each.name for each in rows]


def test_rows_say_what_prims_are():
    """Oracle: what the stage was made of, prim by prim."""
    rows = {each.name: each for each in children(rich(), "/World")}
    assert list(rows) == ["Cloud", "Ball", "Sim", "Camera", "Part", "Instance", "Guides"]
    assert [each.name for each in rows.values() if each.is_splats] == ["Cloud"]
    assert [each.name for each in rows.values() if each.is_camera] == ["Camera"]
    assert [each.name for each in rows.values() if each.is_affector] == ["Ball"]
    assert [each.name for each in rows.values() if each.is_simulation] == ["Sim"]
    assert [each.name for each in rows.values() if each.is_instance] == ["Instance"]
    assert [each.name for each in rows.values() if each.has_children] == ["Instance", "Guides"]
    assert rows["Ball"].type_name == "Sphere" and rows["Ball"].path == "/World/Ball"
    assert rows["Part"].variants == (("season", "summer", ("autumn", "summer")),)
    assert rows["Guides"].purpose == "guide" and rows["Ball"].purpose == "default"
    assert not rows["Sim"].is_imageable and rows["Sim"].purpose == ""
    (world,) = children(rich(), "/")
    assert world.kind == "assembly" and world.path == "/World"


def test_what_an_ancestor_says_holds_below():
    """Oracle: purpose and visibility as USD inherits them."""
    stage = rich()
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/Guides")).MakeInvisible()
    (cube,) = children(stage, "/World/Guides")
    assert cube.purpose == "guide"
    assert not cube.is_visible and not cube.is_hidden_itself
    guides = row(stage, "/World/Guides")
    assert not guides.is_visible and guides.is_hidden_itself
    assert row(stage, "/World/Ball").is_visible


def test_visibility_is_that_of_the_time():
    """Oracle: a prim that is hidden from frame 5 on."""
    stage = rich()
    attribute = UsdGeom.Imageable(stage.GetPrimAtPath("/World/Ball")).CreateVisibilityAttr()
    attribute.Set("inherited", 1)
    attribute.Set("invisible", 5)
    assert row(stage, "/World/Ball", time=4.0).is_visible
    assert not row(stage, "/World/Ball", time=5.0).is_visible


def test_inactive_prims_are_shown_and_classes_and_overs_on_request():
    """Oracle: usdview's tree and its three switches."""
    stage = rich()
    stage.GetPrimAtPath("/World/Guides").SetActive(False)
    (guides,) = [each for each in children(stage, "/World") if each.name == "Guides"]
    assert not guides.is_active and not guides.has_children
    assert names(children(stage, "/")) == ["World"]
    assert names(children(stage, "/", abstract=True)) == ["World", "_class"]
    assert "Over" in names(children(stage, "/World", undefined=True))
    everything = children(stage, "/", undefined=True, abstract=True)
    assert [each.is_abstract for each in everything] == [False, True]


def test_what_is_in_an_instance_is_shown_and_says_so():
    """Oracle: the cube of the class that the instance refers to."""
    (cube,) = children(rich(), "/World/Instance")
    assert cube.path == "/World/Instance/Cube" and cube.is_in_instance


def test_pages_are_parts_of_the_whole():
    """Oracle: the whole list."""
    stage = rich()
    whole = children(stage, "/World")
    pages = [children(stage, "/World", first=first, most=3) for first in (0, 3, 6, 9)]
    assert [len(page) for page in pages] == [3, 3, 1, 0]
    assert tuple(each for page in pages for each in page) == whole


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("ball", ["/World/Ball"]),
        ("SPHERE", ["/World/Ball"]),
        ("  cub ", ["/World/Instance/Cube", "/World/Guides/Cube"]),
        ("c*e", ["/World/Instance/Cube", "/World/Guides/Cube"]),
        ("b?ll", ["/World/Ball"]),
        ("b?l", []),
        ("/world/g", ["/World/Guides", "/World/Guides/Cube"]),
        ("*/Guides", ["/World/Guides"]),
        ("particlefield", ["/World/Cloud"]),
        ("_class", []),
        ("", []),
        ("[", []),
        ("(*", []),
        ("\0", []),
    ],
)
def test_search_looks_at_names_types_and_paths(text, found):
    """Oracle: a person's expectation of each text; a text is never an expression that fails."""
    assert list(search(rich(), text)) == found


def test_search_is_bounded_and_in_the_order_of_the_stage():
    """Oracle: counted by hand, on a stage of thousands."""
    stage = many(2000)
    assert len(search(stage, "ball")) == 1000
    assert search(stage, "ball", most=2) == ("/Group0/Ball0", "/Group0/Ball1")
    assert search(stage, "ball1999") == ("/Group9/Ball1999",)
    assert len(children(stage, "/")) == 10
    assert len(children(stage, "/Group3")) == 200


@pytest.mark.parametrize(
    "path", ["", "World", "/None", "/World.radius", "//", "\0", "/World/Over/x"]
)
def test_what_is_no_prim_is_a_sentence(path):
    """Oracle: the shape of all our errors."""
    with pytest.raises(StageError, match=r"found .+, expected .+"):
        children(rich(), path)
