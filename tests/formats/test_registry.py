"""Tests of the choice of reader and writer, and of errors for unknown formats."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from tests.formats.samples import SPLAT_ROW, ply, random_cloud, sog_files, spz, zipped
from usdsplat import formats
from usdsplat.core.errors import FormatError, OutputError, UnknownFormatError, UsageError


def test_suffixes_are_those_of_the_modules():
    """Oracle: the formats of the issue."""
    read = {".ply", ".compressed.ply", ".ksplat", ".sog", "/meta.json", ".splat", ".spz"}
    read |= {"/lod-meta.json"}
    assert set(formats.suffixes_read()) == read | {".glb", ".gltf"}
    written = {".ply", ".compressed.ply", ".sog", "/meta.json", ".splat", ".spz", ".glb"}
    assert set(formats.suffixes_written()) == written


@pytest.mark.parametrize("name", ["a.ply", "a.PLY", "a.spz", "a", "a.backup"])
def test_content_decides_which_format_reads(tmp_path, name):
    """Oracle: the bytes are those of a PLY, an SPZ and a SOG file."""
    (tmp_path / name).write_bytes(ply(np.array([SPLAT_ROW])))
    assert formats.read(tmp_path / name).format.startswith("PLY")
    (tmp_path / name).write_bytes(spz(bytes(19), count=1))
    assert formats.read(tmp_path / name).format == "SPZ 2"
    assert formats.read(str(zipped(tmp_path / name, sog_files()))).format == "SOG 2"


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".sog", ".spz"])
def test_the_suffix_decides_where_content_says_nothing(tmp_path, suffix):
    """Oracle: each format's own complaint about a text."""
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"no capture at all")
    with pytest.raises(FormatError, match=r"a line 'ply'|b'no c' at the start|damaged archive"):
        formats.read(path)


def test_an_unknown_file_or_folder_is_told_what_is_known(tmp_path):
    """Oracle: the suffixes, in the sentence."""
    (tmp_path / "scene.json").write_bytes(b"{}")
    with pytest.raises(UnknownFormatError, match=r"found suffix '.json', expected one of .*\.spz"):
        formats.read(tmp_path / "scene.json")
    with pytest.raises(UnknownFormatError, match=r"a directory without meta.json"):
        formats.read(tmp_path)


def test_what_cannot_be_opened_is_a_sentence(tmp_path):
    """Oracle: the operating system's own reasons."""
    with pytest.raises(FormatError, match="found no such file or directory, expected a readable"):
        formats.read(tmp_path / "none.ply")
    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(FormatError, match="neither file nor folder"):
        formats.read(tmp_path / "pipe.ply")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(FormatError, match="not a directory"):
        formats.read(tmp_path / "file" / "a.ply")


@pytest.mark.parametrize("name", ["a.ksplat", "a.gltf", "a", "a.txt"])
def test_only_what_can_be_written_is_written(tmp_path, name):
    """Oracle: the suffixes that can."""
    with pytest.raises(UnknownFormatError, match=r"expected one of \."):
        formats.write(random_cloud(1, 0), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", formats.suffixes_written())
@pytest.mark.parametrize("field", ["positions", "scales", "rotations", "opacities", "sh"])
def test_numbers_that_are_not_finite_are_refused_and_nothing_written(tmp_path, suffix, field):
    """Oracle: our readers, which refuse such files; bytes would say something else in silence."""
    cloud = random_cloud(10, 1)
    getattr(cloud, field)[3] = np.nan
    with pytest.raises(OutputError, match=f"found {field} that are not finite, expected"):
        formats.write(cloud, f"{tmp_path}/a{suffix}")
    assert list(tmp_path.iterdir()) == []


def test_formats_need_neither_usd_nor_numba_nor_codecs_until_they_read():
    """Oracle: the modules that a fresh process has loaded."""
    heavy = "pxr numba PIL zstandard isal plyfile scipy"
    code = (
        f"import sys, usdsplat.formats; print([m for m in '{heavy}'.split() if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_level_that_a_capture_does_not_have_is_refused(tmp_path):
    """Oracle: where: found X, expected Y."""
    formats.write(random_cloud(1, 0), tmp_path / "a.ply")
    with pytest.raises(UsageError, match=r"a\.ply: level of detail: found 2, expected 0"):
        formats.read(tmp_path / "a.ply", how=formats.ReadOptions(lod=2))


@pytest.mark.parametrize("suffix", sorted({".ply", ".splat", ".spz", ".sog", ".compressed.ply"}))
def test_what_writing_costs_is_what_reading_says(tmp_path, suffix):
    """Oracle: the bounds that the reader of the same file gives."""
    path = tmp_path / f"a{suffix}"
    bounds = formats.write(random_cloud(5, 0), path)
    assert bounds == formats.read(path).error_bounds
    assert bool(bounds) == (suffix != ".ply")


def test_only_gltf_defines_a_unit():
    """Oracle: glTF 2.0: all lengths are in metres; the others' descriptions name no unit."""
    units = {suffix: formats.unit_written(f"a{suffix}") for suffix in formats.suffixes_written()}
    assert units.pop(".glb") == 1.0
    assert units and set(units.values()) == {None}
