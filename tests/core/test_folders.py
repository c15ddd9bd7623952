"""Tests of folders that are made for output files."""

from __future__ import annotations

import os

import pytest

from usdsplat.core.errors import OutputError
from usdsplat.core.folders import check_folder, made_folder


def test_missing_folders_are_made(tmp_path):
    """Oracle: the file system."""
    with made_folder(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "file").touch()
    assert (tmp_path / "a" / "b" / "file").exists()


def test_an_error_takes_only_new_and_empty_folders_away(tmp_path):
    """Oracle: the file system: what was there, and what others wrote, stays."""
    (tmp_path / "old").mkdir()
    with pytest.raises(KeyError), made_folder(tmp_path / "old" / "new" / "newer"):
        raise KeyError
    assert list((tmp_path / "old").iterdir()) == []
    with pytest.raises(KeyError), made_folder(tmp_path / "old" / "new" / "newer"):
        (tmp_path / "old" / "new" / "theirs").touch()
        raise KeyError
    assert [path.name for path in (tmp_path / "old" / "new").iterdir()] == ["theirs"]


def test_a_folder_inside_a_file_is_refused(tmp_path):
    """Oracle: one sentence with the place."""
    (tmp_path / "file").touch()
    refused = pytest.raises(OutputError, match=r"file.*expected a place where a folder can be made")
    with refused, made_folder(tmp_path / "file" / "a"):
        pass


def test_nothing_can_be_written_below_a_folder_that_may_not_be_searched(tmp_path, monkeypatch):
    """Oracle: the sentence. Root may search everywhere, so `os.stat` and `os.access` say what they
    say to others."""
    closed, look = tmp_path / "closed", os.stat
    closed.mkdir()

    def denied(path, *args, **options):
        if not isinstance(path, int) and f"{closed}{os.sep}" in os.fspath(path):
            raise PermissionError(13, "Permission denied", str(path))
        return look(path, *args, **options)

    monkeypatch.setattr(os, "stat", denied)
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != str(closed))
    with pytest.raises(OutputError, match="found a folder without write permission"):
        check_folder(closed / "new" / "below")


def test_a_folder_is_checked_before_it_is_made(tmp_path, monkeypatch):
    """Oracle: the sentences; nothing is made. Root may write everywhere, so `os.access` is asked
    to say no."""
    check_folder(tmp_path / "new" / "below")
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"found a file, .*/file, expected a place"):
        check_folder(tmp_path / "file" / "below")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match="found a folder without write permission"):
        check_folder(tmp_path / "new" / "below")
    assert [each.name for each in tmp_path.iterdir()] == ["file"]
