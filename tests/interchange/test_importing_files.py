"""Tests of the files, units and notes of an import."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.interchange.samples import assert_same, capture
from tests.schema.clouds import cloud
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.errors import (
    FormatError,
    OutputError,
    UnknownFormatError,
)
from usdsplat.interchange import import_capture
from usdsplat.interchange.options import ImportOptions

RDF_TO = {"Y": np.diag([1, -1, -1]), "Z": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])}


RDF_TO = {"Y": np.diag([1, -1, -1]), "Z": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])}


def field(path: Path | Usd.Stage, prim_path: str = "/tree/splats") -> Usd.Prim:
    """A prim of a file; the stage stays open as long as the process."""
    stage = path if isinstance(path, Usd.Stage) else Usd.Stage.Open(str(path))
    OPEN.append(stage)
    return stage.GetPrimAtPath(prim_path)


OPEN: list[Usd.Stage] = []


def test_targets_that_are_no_usd_file_are_refused(tmp_path: Path) -> None:
    """Oracle: the documented error, which lists what can be written."""
    with pytest.raises(UnknownFormatError, match=r"\.usdc"):
        import_capture(capture(tmp_path), tmp_path / "a.obj")


def test_the_source_is_never_the_target(tmp_path: Path) -> None:
    """Oracle: the file's bytes, also through a link with a USD name."""
    source = capture(tmp_path)
    before = source.read_bytes()
    link = tmp_path / "link.usdc"
    link.symlink_to(source)
    with pytest.raises(OutputError, match="being read"):
        import_capture(source, link)
    assert source.read_bytes() == before


def test_a_bad_capture_leaves_an_older_result_alone(tmp_path: Path) -> None:
    """Oracle: the bytes of the older result."""
    target = tmp_path / "a.usdc"
    import_capture(capture(tmp_path), target)
    before = target.read_bytes()
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat nonsense")
    with pytest.raises(FormatError):
        import_capture(tmp_path / "bad.ply", target)
    assert target.read_bytes() == before


def test_a_missing_folder_is_one_sentence(tmp_path: Path) -> None:
    """Oracle: the documented error."""
    with pytest.raises(OutputError, match="folder"):
        import_capture(capture(tmp_path), tmp_path / "nowhere" / "a.usdc")


def test_an_open_stage_of_the_old_file_is_not_disturbed(tmp_path: Path) -> None:
    """Oracle: numbers read after the file was replaced, from a stage opened before."""
    target = tmp_path / "a.usdc"
    import_capture(capture(tmp_path, seed=1, n=3000), target)
    prim = field(target)
    found = schema.fetch(prim)
    import_capture(capture(tmp_path, seed=2, n=10), target)
    np.testing.assert_array_equal(found.positions, cloud(1, n=3000).positions)


def test_progress_tells_of_authoring_and_writing(tmp_path: Path) -> None:
    """Oracle: a listener; every piece of work ends at its total."""
    heard: dict[str, tuple[int, int]] = {}

    class Listener:
        def step(self, label: str, done: int, total: int) -> None:
            heard[label] = (done, total)

    import_capture(capture(tmp_path), tmp_path / "a.usdc", progress=Listener())
    assert {"authoring", "writing"} <= set(heard)
    assert all(done == total for done, total in heard.values())


def test_a_usdz_is_one_package_that_others_can_read(tmp_path: Path) -> None:
    """Oracle: USD's own package reader: one crate layer, aligned to 64 bytes."""
    target = tmp_path / "tree.usdz"
    import_capture(capture(tmp_path), target)
    package = (
        Sdf.ZipFile.Open(str(target)) if hasattr(Sdf, "ZipFile") else Usd.ZipFile.Open(str(target))
    )
    assert package.GetFileNames() == ["tree.usdc"]
    assert package.GetFileInfo("tree.usdc").dataOffset % 64 == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tree.ply", "tree.usdz"]


def test_a_field_equals_the_edited_cloud_in_world_space(tmp_path: Path) -> None:
    """Oracle: `core.edit` on the capture, against baked arrays."""
    source = capture(tmp_path)
    import_capture(source, tmp_path / "a.usdc", options=ImportOptions(bake_axes=True))
    turn = np.eye(4)
    turn[:3, :3] = RDF_TO["Y"]
    assert_same(
        schema.fetch(field(tmp_path / "a.usdc")),
        edit.transform(formats.read(source).cloud, turn),
    )


@pytest.mark.parametrize(
    ("form", "degree", "said"),
    [
        ("float", 3, None),
        ("packed", 4, None),
        ("half", 1, "only orientationsh, scalesh, opacitiesh"),
        ("float", 4, "found 4, expected at most 3"),
    ],
)
def test_an_import_says_which_published_rule_its_form_breaks(tmp_path, form, degree, said) -> None:
    """Oracle: NVIDIA's rule VG.035 for stock prims: float attributes and degrees 0 to 3."""
    report = import_capture(
        capture(tmp_path, degree=degree), tmp_path / "a.usdc", options=ImportOptions(form=form)
    )
    found = [note for note in report.notes if "VG.035" in note]
    assert [said in note for note in found] == ([True] if said else [])


@pytest.mark.parametrize(("unit", "factor"), [(1.0, 1.0), (0.01, 100.0)])
def test_a_glb_has_its_size_on_a_stage_of_any_unit(tmp_path: Path, unit, factor) -> None:
    """Oracle: glTF's unit is the metre; centres in world space, by Gf."""
    source = cloud(n=20)
    formats.write(source, tmp_path / "tree.glb")
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    report = import_capture(tmp_path / "tree.glb", stage)
    prim = field(stage, report.prim_path)
    matrix = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0)
    found = [matrix.Transform(Gf.Vec3d(*map(float, p))) for p in schema.fetch(prim).positions]
    np.testing.assert_allclose(found, factor * source.positions, rtol=1e-6)
    memory = prim.GetCustomDataByKey("usdsplat")
    assert (memory["meters_per_unit"], memory["unit_source"]) == (1.0, "file")
    assert not any("a unit" in note for note in report.notes)


def test_the_prim_remembers_the_unit_and_where_it_is_from(tmp_path: Path) -> None:
    """Oracle: the option, or the stage's unit that is assumed."""
    source = capture(tmp_path, degree=2)
    found = []
    for unit in (0.01, None):
        stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        report = import_capture(source, stage, options=ImportOptions(meters_per_unit=unit))
        memory = field(stage, report.prim_path).GetCustomDataByKey("usdsplat")
        found.append([memory[name] for name in ("meters_per_unit", "unit_source", "sh_degree")])
    assert found == [[0.01, "given", 2], [1.0, "assumed", 2]]
