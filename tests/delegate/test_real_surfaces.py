"""Tests with meshes on stages of other projects."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd

from usdsplat.delegate.engine import Engine

STAGES = {
    "usdwg/CesiumMan.usdz": 1,
    "usdwg/RiggedFigure.usdz": 1,
    "usdwg/RiggedSimple.usdz": 1,
    "usdwg/BoxAnimated.usdz": 2,
    "usdwg/InterpolationTest.usdz": None,
    "usdwg/SubdivisionSurfaces/Creases_SpinningPyramids.usda": 3,
}


@pytest.mark.parametrize("name", STAGES)
def test_stages_of_others_are_drawn_without_a_warning(data, name):
    """Oracle: the number of their meshes, and that all numbers are finite and in range. Some have
    gloss, which is a note."""
    stage = Usd.Stage.Open(str(data / "usd" / name))
    with Engine(stage, time=stage.GetStartTimeCode()) as engine:
        drawn = engine.render_scene.drawn_meshes()
        assert all(each.code == "diffuse-surfaces" for each in engine.findings)
        assert len(drawn) == (STAGES[name] or len(drawn)) > 0
        for _, mesh, _ in drawn:
            spec = mesh.spec
            assert np.isfinite(spec.points).all() and len(spec.triangles) == len(spec.faces)
            assert spec.triangles.min() >= 0 and spec.triangles.max() < len(spec.points)


def test_the_walking_man_is_textured_and_walks(data):
    """Oracle: his picture's size, and that points move while the topology stays."""
    stage = Usd.Stage.Open(str(data / "usd/usdwg/CesiumMan.usdz"))
    with Engine(stage, time=1) as engine:
        ((_, mesh, _),) = engine.render_scene.drawn_meshes()
        before = mesh.spec
        assert before.materials[0].texture.pixels.shape == (1024, 1024, 3)
        engine.set_time(10)
        ((_, mesh, _),) = engine.render_scene.drawn_meshes()
        assert np.abs(mesh.spec.points - before.points).max() > 0.01
        assert mesh.spec.triangles is before.triangles and mesh.spec.uvs is before.uvs


def test_a_kit_without_its_textures_says_so_and_keeps_its_subsets(data):
    """Oracle: the kit's seven materials, and that its picture files are not in the data."""
    path = data / "usd/usdwg/Vehicles/assets/vehicles/ambulance/asset/ambulanceFullAsset.usda"
    with Engine(Usd.Stage.Open(str(path))) as engine:
        (body,) = [
            mesh.spec
            for _, mesh, i in engine.render_scene.drawn_meshes()
            if i.path == "/ambulance/ambulance/geo"
        ]
        assert len(body.materials) == 7 and set(body.material_of.tolist()) == set(range(7))
        assert engine.warnings and all("inputs:file: found" in each for each in engine.warnings)
