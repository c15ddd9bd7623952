"""Tests of the writer of USD files."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdUtils

from usdsplat.core.errors import OutputError
from usdsplat.core.output import output_file
from usdsplat.schema import usd_files
from usdsplat.schema.usd_files import export_layer, is_whole_usd, new_layer, save_layer


@pytest.fixture
def layer() -> Sdf.Layer:
    """A small layer."""
    made = Sdf.Layer.CreateAnonymous(".usda")
    spec = Sdf.AttributeSpec(Sdf.CreatePrimInLayer(made, "/A"), "x", Sdf.ValueTypeNames.FloatArray)
    spec.default = [float(number) for number in range(1000)]
    return made


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc", ".usdz"])
def test_a_layer_is_written_whole(tmp_path: Path, layer: Sdf.Layer, suffix: str) -> None:
    """Oracle: USD reads the same text back; every shorter file is not whole."""
    target = tmp_path / f"a{suffix}"
    export_layer(layer, target)
    assert os.listdir(tmp_path) == [target.name]
    stage = Usd.Stage.Open(str(target))
    assert stage.GetRootLayer().ExportToString() == layer.ExportToString()
    assert is_whole_usd(target)
    data = target.read_bytes()
    for missing in (2, 30, 300, len(data) // 2, len(data) - 12, len(data)):
        (tmp_path / "cut").write_bytes(data[:-missing])
        assert not is_whole_usd(tmp_path / "cut"), missing


def test_an_empty_layer_is_whole(tmp_path: Path) -> None:
    """Oracle: USD's own files of an empty layer."""
    for suffix in (".usda", ".usdc"):
        export_layer(Sdf.Layer.CreateAnonymous(), tmp_path / f"a{suffix}")
        assert is_whole_usd(tmp_path / f"a{suffix}")


def test_a_package_is_usds_own_but_for_its_dates(tmp_path: Path, layer: Sdf.Layer) -> None:
    """Oracle: CreateNewUsdzPackage of the same layer, byte for byte but for dates and times."""
    export_layer(layer, tmp_path / "a.usdz")
    with zipfile.ZipFile(tmp_path / "a.usdz") as archive:
        archive.extractall(tmp_path / "x")
    theirs = tmp_path / "theirs.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "x" / "a.usdc"), str(theirs))
    expected, found = theirs.read_bytes(), (tmp_path / "a.usdz").read_bytes()
    with zipfile.ZipFile(theirs) as archive:
        contents = archive.start_dir
    dates = {*range(10, 14), *range(contents + 12, contents + 16)}
    differing = {i for i, (a, b) in enumerate(zip(expected, found, strict=True)) if a != b}
    assert differing <= dates


def test_a_package_has_the_files_that_a_layer_refers_to(tmp_path: Path) -> None:
    """Oracle: the members of CreateNewUsdzPackage, in its order, and the textures that USD finds in
    the package."""
    for name in ("one.png", "zweì.png"):
        (tmp_path / name).write_bytes(name.encode())
    below = Sdf.Layer.CreateNew(str(tmp_path / "below.usda"))
    below.ImportFromString('#usda 1.0\ndef "B" {\n asset one = @./one.png@\n}\n')
    below.Save()
    layer = Sdf.Layer.CreateNew(str(tmp_path / "source.usda"))
    layer.ImportFromString(
        f"#usda 1.0\n(subLayers = [@{tmp_path}/below.usda@])\n"
        f'def "A" {{\n asset two = @{tmp_path}/zweì.png@\n}}\n'
    )
    layer.Save()
    (tmp_path / "new").mkdir()
    export_layer(layer, tmp_path / "new" / "a.usdz")
    assert os.listdir(tmp_path / "new") == ["a.usdz"]
    theirs = tmp_path / "theirs.usdz"
    (tmp_path / "x").mkdir()
    assert layer.Export(str(tmp_path / "x" / "a.usdc"))
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "x" / "a.usdc"), str(theirs))
    lists = []
    for path in (theirs, tmp_path / "new" / "a.usdz"):
        with zipfile.ZipFile(path, metadata_encoding="utf-8") as archive:
            assert archive.testzip() is None
            lists.append([item.filename for item in archive.infolist()])
    assert lists[0] == lists[1] and len(lists[0]) == 4
    (tmp_path / "one.png").unlink()
    stage = Usd.Stage.Open(str(tmp_path / "new" / "a.usdz"))
    for place in ("/B.one", "/A.two"):
        value = stage.GetAttributeAtPath(place).Get()
        assert value.resolvedPath == f"{tmp_path}/new/a.usdz[{value.path}]"


def test_a_missing_texture_does_not_stop_a_package(tmp_path: Path) -> None:
    """Oracle: the members; USD's function returns False here, although its package is whole."""
    layer = Sdf.Layer.CreateAnonymous()
    layer.ImportFromString('#usda 1.0\ndef "A" {\n asset x = @./none.png@\n}\n')
    export_layer(layer, tmp_path / "a.usdz")
    assert zipfile.ZipFile(tmp_path / "a.usdz").namelist() == ["a.usdc"]


class Refusing:
    """A layer whose writing fails without an exception, as a full disk can make it."""

    def __init__(self, path: Path) -> None:
        self.realPath = str(path)

    def Export(self, path: str) -> bool:
        """Write half a file, and say so."""
        Path(path).write_bytes(b"#usda 1.0\nhalf")
        return False

    Save = lambda self: self.Export(self.realPath)  # noqa: E731


class Silent(Refusing):
    """A layer whose writing fails without being noticed."""

    def Export(self, path: str) -> bool:
        """Write half a file, and say nothing."""
        return not super().Export(path)


@pytest.mark.parametrize("kind", [Refusing, Silent])
def test_a_failure_that_usd_does_not_raise_is_raised(tmp_path: Path, kind: type[Refusing]) -> None:
    """Oracle: the result of Export and of Save, the file itself, and the old bytes."""
    target = tmp_path / "a.usda"
    target.write_bytes(b"old")
    with pytest.raises(OutputError, match=r"a\.usda: found a truncated file"):
        export_layer(kind(target), target)
    with (
        pytest.raises(OutputError, match="truncated"),
        output_file(target) as output,
    ):
        save_layer(kind(output.path), output)
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.usda"]


def test_usds_exceptions_become_sentences(tmp_path: Path) -> None:
    """Oracle: a folder that does not exist, for which USD raises Tf.ErrorException."""
    with (
        pytest.raises(OutputError, match=r"a\.usdc: found .*, expected a file that USD can write"),
        output_file(tmp_path / "a.usdc") as output,
    ):
        layer = new_layer(output.path, output)
        os.rename(output.path.parent, tmp_path / "moved")
        (tmp_path / output.path.parent.name).write_bytes(b"")
        layer.defaultPrim = "A"
        usd_files.save_layer(layer, output)
