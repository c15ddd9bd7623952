"""Tests of overs with new colours of splats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.schema import tokens

PATH = "/World/Splats"


@pytest.fixture
def over(stage: Usd.Stage) -> Usd.Stage:
    """A stage over another, for overs."""
    found = Usd.Stage.CreateInMemory()
    found.GetRootLayer().subLayerPaths.append(stage.GetRootLayer().identifier)
    return found


def recolored(prim: Usd.Prim, over: Usd.Stage) -> tuple[np.ndarray, np.ndarray]:
    """Author other colours of a field; return them, and those that are read."""
    source = schema.fetch(prim)
    wanted = replace(source, sh=source.sh + np.float32(0.25))
    schema.author_radiance(over, prim, wanted)
    return wanted.sh, schema.fetch(over.GetPrimAtPath(prim.GetPath())).sh


@pytest.mark.parametrize("names", [(), (tokens.SH_DEGREE,)])
def test_a_field_without_colours_of_its_own_gets_readable_ones(
    stage: Usd.Stage, over: Usd.Stage, names: tuple[str, ...]
) -> None:
    """Oracle: the colours that were written; the schema's own degree is 3, and grey has one
    coefficient."""
    prim = schema.author(stage, PATH, cloud(n=7))
    for name in {tokens.SH_COEFFICIENTS, tokens.SH_DEGREE} - set(names):
        prim.RemoveProperty(name)
    wanted, found = recolored(prim, over)
    np.testing.assert_array_equal(found, wanted)
    assert found.shape == (7, 1, 3)


@pytest.mark.parametrize("form", ["float", "half", "packed"])
def test_each_form_reads_what_was_written(stage: Usd.Stage, over: Usd.Stage, form: str) -> None:
    """Oracle: the colours, to the error of the form."""
    wanted, found = recolored(schema.author(stage, PATH, cloud(n=20), form=form), over)
    np.testing.assert_allclose(found, wanted, atol=0.02)


def test_only_the_proxy_of_a_packed_field_gets_its_colours(
    stage: Usd.Stage, over: Usd.Stage
) -> None:
    """Oracle: the properties of what proxyPrim names: a card of another artist, then the proxy."""
    prim = schema.author(stage, PATH, cloud(n=20), form="packed")
    relationship = prim.GetRelationship(tokens.PROXY_PRIM)
    (points,) = relationship.GetTargets()
    recolored(prim, over)
    assert over.GetRootLayer().GetPrimAtPath(points).properties
    UsdGeom.Mesh.Define(stage, "/World/Card")
    relationship.SetTargets(["/World/Card"])
    over.GetRootLayer().GetPrimAtPath("/World").nameChildren.clear()
    recolored(prim, over)
    assert not over.GetRootLayer().GetPrimAtPath("/World/Card")


def test_a_packed_field_at_the_root_colours_nothing_else(over: Usd.Stage, stage: Usd.Stage) -> None:
    """Oracle: the prims of the layer; a field at the root has no proxy."""
    prim = schema.author(stage, "/Splats", cloud(n=20), form="packed")
    UsdGeom.Mesh.Define(stage, "/Card")
    prim.CreateRelationship(tokens.PROXY_PRIM, custom=False).SetTargets(["/Card"])
    recolored(prim, over)
    assert [each.name for each in over.GetRootLayer().rootPrims] == ["Splats"]
