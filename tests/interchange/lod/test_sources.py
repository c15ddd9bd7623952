"""Tests of reading inputs in parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from tests.interchange.lod.worlds import NAMES, ground, in_parts
from usdsplat import formats, schema
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import silent
from usdsplat.interchange.exporting import capture_of
from usdsplat.interchange.lod import ply_source, survey
from usdsplat.interchange.lod.inputs import open_source
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.sorting import pieces


@pytest.mark.parametrize("form", ["packed", "float", "half"])
def test_a_stage_is_read_in_parts(tmp_path, form):
    """Oracle: the export of the same stage, whole, with its point instances."""
    path = tmp_path / "s.usda"
    stage = Usd.Stage.CreateNew(str(path))
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/many")
    prim = schema.author(stage, "/World/many/kind", ground(100, 2), form=form)
    UsdGeom.Xformable(prim).AddRotateXYZOp().Set(Gf.Vec3f(20, 30, 40))
    instancer.CreatePrototypesRel().SetTargets([prim.GetPath()])
    instancer.CreatePositionsAttr(Vt.Vec3fArray([(0, 0, 0), (5, 1, 0)]))
    instancer.CreateProtoIndicesAttr(Vt.IntArray([0, 0]))
    stage.GetRootLayer().Save()
    source = open_source(path, LodOptions())
    told = source.survey(silent)
    assert (told.parts, told.degree, told.frame) == ((100, 100), 2, "rub")
    expected = capture_of(stage, "rub")[0].cloud
    found = in_parts(source, told.parts, 37)
    for name in NAMES:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-6)
    np.testing.assert_allclose(told.low, expected.positions.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(told.high, expected.positions.max(axis=0), atol=1e-6)


@pytest.mark.parametrize(
    ("names", "notes"),
    [
        ((), ()),
        (("ids",), ("ids of fields are not kept",)),
        (("ids", "velocities"), ("ids and velocities of fields are not kept",)),
    ],
)
@pytest.mark.parametrize("form", ["packed", "float"])
def test_ids_and_velocities_that_are_not_kept_are_one_note(tmp_path, names, notes, form):
    """Oracle: by hand; two fields have them, a third has none."""
    path = tmp_path / "s.usda"
    stage = Usd.Stage.CreateNew(str(path))
    cloud = ground(50)
    both = {"ids": np.arange(50), "velocities": np.ones((50, 3), np.float32)}
    for name in ("/a", "/b"):
        with_both = replace(cloud, **{each: both[each] for each in names})
        schema.author(stage, name, with_both, form=form, time=1.0)
    schema.author(stage, "/c", cloud, form=form)
    stage.GetRootLayer().Save()
    assert open_source(path, LodOptions(time=1.0)).survey(silent).notes == notes


def test_an_authored_footprint_is_the_pixel(tmp_path):
    """Oracle: closed form: the footprint times the scale of the field."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    drawing = schema.DrawingHints(footprint=0.02)
    prim = schema.author(stage, "/a", ground(50), drawing=drawing)
    UsdGeom.Xformable(prim).AddScaleOp().Set(Gf.Vec3f(3, 3, 3))
    stage.GetRootLayer().Save()
    told = open_source(tmp_path / "s.usda", LodOptions()).survey(silent)
    assert told.pixel == pytest.approx(0.06)
    assert told.footprints == pytest.approx((0.06, 0.06))


def test_a_stage_surveys_the_hints_of_its_fields(tmp_path):
    """Oracle: the values that are authored; a field without them has the defaults of USD."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    drawing = schema.DrawingHints(projection_mode="tangential", sorting_mode="cameraDistance")
    schema.author(stage, "/a", ground(50), drawing=drawing)
    schema.author(stage, "/b", ground(50), drawing=schema.DrawingHints(footprint=0.5))
    stage.GetRootLayer().Save()
    told = open_source(tmp_path / "s.usda", LodOptions()).survey(silent)
    assert told.projection_modes == ("perspective", "tangential")
    assert told.sorting_modes == ("cameraDistance", "zDepth")
    assert told.footprints == (0.0, 0.5)


@pytest.mark.parametrize("name", ["a.ply", "a.splat"])
def test_a_capture_is_read_in_parts(tmp_path, monkeypatch, name):
    """Oracle: the reader of its format, and a survey of the whole."""
    monkeypatch.setattr(survey, "SAMPLED", 40)
    formats.write(ground(100, 0), tmp_path / name)
    source = open_source(tmp_path / name, LodOptions(axes="rdf"))
    whole = source.survey(silent)
    for window in (17, 100):
        monkeypatch.setattr(ply_source, "WINDOW", window)
        assert source.survey(silent) == whole
    source.release()
    expected = formats.read(tmp_path / name).cloud
    found = in_parts(source, whole.parts, 30)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert whole.parts == (100,)


def test_a_splat_that_cannot_be_drawn_counts_as_a_row(tmp_path):
    """Oracle: closed form: of 100 rows, one has the rotation zero, in the second part."""
    cloud = ground(100)
    cloud.rotations[60] = 0
    formats.write(cloud, tmp_path / "a.ply")
    source = open_source(tmp_path / "a.ply", LodOptions(axes="rdf"))
    assert source.survey(silent).parts == (100,)
    parts = [source.rows(0, first, first + 50, np.eye(4)) for first in (0, 50)]
    assert [len(part) for part in parts] == [50, 49]


def test_a_capture_that_does_not_fit_is_one_sentence(tmp_path):
    """Oracle: the sentence."""
    formats.write(ground(1000), tmp_path / "a.splat")
    source = open_source(tmp_path / "a.splat", LodOptions(memory_limit=1000))
    with pytest.raises(UsageError, match=r"a\.splat, which takes .* expected a higher limit"):
        source.survey(silent)


class Counted:
    """A survey of which only the numbers of splats count."""

    def __init__(self, *parts):
        self.parts = parts


def test_pieces_hold_each_splat_once_in_order():
    """Oracle: closed form: 10 splats of three inputs in pieces of 4."""
    found = list(pieces([Counted(3, 0, 2), Counted(), Counted(5)], 4))
    told = [[(r.source, r.part, r.first, r.last) for r in piece] for piece in found]
    assert told == [
        [(0, 0, 0, 3), (0, 2, 0, 1)],
        [(0, 2, 1, 2), (2, 0, 0, 3)],
        [(2, 0, 3, 5)],
    ]
