"""Tests of atomic outputs. Oracle of all: the files that exist afterwards."""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path

import pytest

from usdsplat.core.errors import FormatError, OutputError
from usdsplat.core.output import atomic_path


def test_the_target_appears_only_when_the_block_ends(tmp_path: Path) -> None:
    """Oracle: existence before, within and after the block."""
    target = tmp_path / "out.compressed.ply"
    with atomic_path(target) as path:
        path.write_bytes(b"new")
        assert path.parent == tmp_path
        assert path.name.startswith(".") and path.name.endswith(".out.compressed.ply")
        assert not target.exists()
    assert target.read_bytes() == b"new"
    assert os.listdir(tmp_path) == [target.name]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type) -> None:
    """Oracle: the folder's listing and the old bytes; Ctrl-C is an error too."""
    target = tmp_path / "out.exr"
    target.write_bytes(b"old")
    with pytest.raises(error), atomic_path(target) as path:
        path.write_bytes(b"half")
        raise error
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [target.name]


def test_two_writers_of_one_target_do_not_meet(tmp_path: Path) -> None:
    """Oracle: both temporary names differ, and the last to finish wins whole."""
    target = tmp_path / "out.png"
    started, finish = threading.Event(), threading.Event()

    def slow() -> None:
        with atomic_path(target) as path:
            path.write_bytes(b"slow")
            started.set()
            finish.wait(5)

    thread = threading.Thread(target=slow)
    thread.start()
    assert started.wait(5)
    with atomic_path(target) as path:
        path.write_bytes(b"quick")
    assert target.read_bytes() == b"quick"
    finish.set()
    thread.join()
    assert target.read_bytes() == b"slow"


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    """Oracle: the link and the file that it points to."""
    (tmp_path / "real").mkdir()
    link = tmp_path / "link.ply"
    link.symlink_to(tmp_path / "real" / "file.ply")
    with atomic_path(link) as path:
        path.write_bytes(b"x")
    assert link.is_symlink()
    assert (tmp_path / "real" / "file.ply").read_bytes() == b"x"


def test_a_missing_folder_is_refused_before_any_work(tmp_path: Path) -> None:
    """Oracle: the block never runs."""
    with (
        pytest.raises(OutputError, match=r"a\.ply: found no folder .*no, expected"),
        atomic_path(tmp_path / "no" / "a.ply"),
    ):
        pytest.fail("the block ran")


def test_a_folder_or_a_device_is_never_replaced(tmp_path: Path) -> None:
    """Oracle: /dev/null is still a device and the folder still a folder."""
    for target in (tmp_path, Path(os.devnull)):
        with (
            pytest.raises(OutputError, match=r"not a plain file|without write permission"),
            atomic_path(target),
        ):
            pytest.fail("the block ran")
    assert tmp_path.is_dir() and not Path(os.devnull).is_file()


def test_a_folder_without_write_permission_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the answer of access(2), replaced here because root may write anywhere."""
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with (
        pytest.raises(OutputError, match="without write permission"),
        atomic_path(tmp_path / "a.ply"),
    ):
        pytest.fail("the block ran")


def test_a_full_disk_is_one_sentence_about_the_target(tmp_path: Path) -> None:
    """Oracle: ENOSPC as the kernel reports it, without a file name."""
    target = tmp_path / "a.ply"
    with (
        pytest.raises(OutputError, match=r"a\.ply: found No space left on device"),
        atomic_path(target) as path,
    ):
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert os.listdir(tmp_path) == []


def test_errors_about_other_files_pass_unchanged(tmp_path: Path) -> None:
    """Oracle: the very error that was raised, ours or the system's."""
    with pytest.raises(FileNotFoundError, match="other"), atomic_path(tmp_path / "a.ply"):
        (tmp_path / "other").read_bytes()
    with pytest.raises(FormatError, match=r"b\.spz"), atomic_path(tmp_path / "a.ply"):
        raise FormatError("b.spz", "nothing", "something")
