"""Tests of opening and saving USD files."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Sdf, Usd

from tests.interchange.samples import capture
from tests.schema.test_value_clips import clipped
from usdsplat.core.errors import OutputError, StageError, UnknownFormatError
from usdsplat.interchange import files, import_capture


@pytest.mark.parametrize("suffix", files.SUFFIXES)
def test_a_disk_that_is_full_leaves_nothing_behind(tmp_path: Path, suffix: str) -> None:
    """Oracle: the kernel's limit on file sizes; one sentence, and an empty folder."""
    code = f"""
import resource
from pathlib import Path
from pxr import Sdf, Vt
from usdsplat.core.errors import OutputError
from usdsplat.interchange import files
layer = Sdf.Layer.CreateAnonymous(".usda")
prim = Sdf.CreatePrimInLayer(layer, "/P")
Sdf.AttributeSpec(prim, "points", Sdf.ValueTypeNames.Point3fArray).default = Vt.Vec3fArray(50_000)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
try:
    files.save(layer, Path({str(tmp_path)!r}, "a{suffix}"))
except OutputError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"a{suffix}: found " in done.stdout
    assert len(done.stdout.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_only_usd_suffixes_are_written(tmp_path: Path) -> None:
    """Oracle: the documented error; suffixes in capitals count."""
    with pytest.raises(UnknownFormatError, match=r"'\.ply', expected one of \.usd \.usda"):
        files.save(Sdf.Layer.CreateAnonymous(), tmp_path / "a.ply")
    assert files.is_usd(Path("A.USDC"))
    assert not files.is_usd(Path("usd"))


def test_the_files_of_a_stage_are_its_layers_and_packages(tmp_path: Path) -> None:
    """Oracle: the names on disk; a package counts, not the layer inside."""
    import_capture(capture(tmp_path), tmp_path / "a.usdz")
    stage = Usd.Stage.CreateNew(str(tmp_path / "b.usda"))
    stage.DefinePrim("/A").GetReferences().AddReference("./a.usdz")
    stage.Save()
    found = {path.name for path in files.layer_files(stage)}
    assert found == {"a.usdz", "b.usda"}
    with pytest.raises(OutputError, match="being read"):
        files.check_not_input(tmp_path / "a.usdz", files.layer_files(stage))


def test_a_clip_that_was_not_read_is_an_input(tmp_path: Path) -> None:
    """Oracle: the documented error; its manifest is known already, so USD has opened no clip."""
    stage = clipped(tmp_path, "a.usdc")
    manifest = Sdf.Layer.CreateNew(str(tmp_path / "manifest.usda"))
    manifest.Save()
    api = Usd.ClipsAPI(stage.GetPrimAtPath("/F"))
    api.SetClipManifestAssetPath(Sdf.AssetPath("./manifest.usda"))
    stage.Save()
    opened = files.open_stage(tmp_path / "shot.usda")
    with pytest.raises(OutputError, match="being read"):
        files.check_not_input(tmp_path / "a.usdc", files.layer_files(opened))


def test_a_folder_is_no_stage(tmp_path: Path) -> None:
    """Oracle: the documented error."""
    with pytest.raises(StageError, match="expected a USD file"):
        files.open_stage(tmp_path)
