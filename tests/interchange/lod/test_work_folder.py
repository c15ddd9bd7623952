"""Tests of the folder in which a tree is built."""

from __future__ import annotations

import os

import pytest

from tests.interchange.lod.test_survey import ONE
from usdsplat.core.errors import OutputError
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.work_folder import WorkFolder


@pytest.fixture
def scan(tmp_path):
    """A file."""
    (tmp_path / "scan.ply").write_bytes(b"ply")
    return tmp_path / "scan.ply"


def folder_of(scan, **options):
    """The work folder of a tree beside a file."""
    return WorkFolder(scan.with_name("t.usda"), [scan], LodOptions(**options))


def test_the_same_job_continues(scan):
    """Oracle: the stored surveys; the limit of memory does not change a tree."""
    first = folder_of(scan)
    assert (first.is_continued, first.surveys()) == (False, None)
    first.store([ONE])
    again = folder_of(scan, memory_limit=1 << 30)
    assert (again.is_continued, again.surveys()) == (True, [ONE])


@pytest.mark.parametrize("change", ["content", "time", "option"])
def test_another_job_finds_an_empty_folder(scan, change):
    """Oracle: nothing is stored."""
    folder_of(scan).store([ONE])
    if change == "content":
        scan.write_bytes(b"ply\n")
    if change == "time":
        os.utime(scan, ns=(1, 1))
    found = folder_of(scan, **({"pixel": 0.5} if change == "option" else {}))
    assert (found.is_continued, found.surveys()) == (False, None)


def test_a_damaged_job_is_another_one(scan):
    """Oracle: nothing is stored."""
    folder_of(scan).store([ONE])
    (scan.parent / ".t.usda.building" / "job.json").write_bytes(b"{")
    assert folder_of(scan).surveys() is None


def test_other_runs_are_removed(scan):
    """Oracle: the names of the files."""
    folder = folder_of(scan)
    for name in ("1_50.keys", "1_50.rows", "1_70.keys"):
        (folder.runs / name).write_bytes(b"")
    folder.remove_other_runs(["1_50"])
    assert sorted(path.name for path in folder.runs.iterdir()) == ["1_50.keys", "1_50.rows"]


def test_a_folder_without_work_is_removed(scan):
    """Oracle: the file system."""
    folder = folder_of(scan)
    folder.remove_if_empty()
    assert not folder.path.exists()
    folder = folder_of(scan)
    folder.store([ONE])
    folder.remove_if_empty()
    assert folder.path.is_dir()


def test_a_place_without_folders_is_one_sentence(scan):
    """Oracle: the sentence: a file is where the folder would be."""
    (scan.parent / ".t.usda.building").write_bytes(b"")
    with pytest.raises(OutputError, match="expected a folder where folders can be made"):
        folder_of(scan)
