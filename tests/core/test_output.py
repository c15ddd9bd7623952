"""Tests of outputs that appear complete or not at all. Oracle of all: the files that exist
afterwards."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from usdsplat.core import output
from usdsplat.core.errors import FormatError, OutputError
from usdsplat.core.output import output_file, output_group


def test_the_target_appears_only_when_the_block_ends(tmp_path: Path) -> None:
    """Oracle: existence before, within and after the block."""
    target = tmp_path / "out.compressed.ply"
    with output_file(target) as made:
        made.path.write_bytes(b"new")
        assert made.path.parent.parent == tmp_path
        assert made.path.name.endswith(".compressed.ply")
        assert not target.exists()
    assert target.read_bytes() == b"new"
    assert os.listdir(tmp_path) == [target.name]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type) -> None:
    """Oracle: the folder's listing and the old bytes; Ctrl-C is an error too."""
    target = tmp_path / "out.exr"
    target.write_bytes(b"old")
    with pytest.raises(error), output_file(target) as made:
        made.path.write_bytes(b"half")
        raise error
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [target.name]


def test_two_writers_of_one_target_do_not_meet(tmp_path: Path) -> None:
    """Oracle: both temporary names differ, and the last to finish wins whole."""
    target = tmp_path / "out.png"
    started, finish = threading.Event(), threading.Event()

    def slow() -> None:
        with output_file(target) as made:
            made.path.write_bytes(b"slow")
            started.set()
            finish.wait(5)

    thread = threading.Thread(target=slow)
    thread.start()
    assert started.wait(5)
    with output_file(target) as made:
        made.path.write_bytes(b"quick")
    assert target.read_bytes() == b"quick"
    finish.set()
    thread.join()
    assert target.read_bytes() == b"slow"


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    """Oracle: the link and the file that it points to."""
    (tmp_path / "real").mkdir()
    link = tmp_path / "link.ply"
    link.symlink_to(tmp_path / "real" / "file.ply")
    with output_file(link) as made:
        made.path.write_bytes(b"x")
    assert link.is_symlink()
    assert (tmp_path / "real" / "file.ply").read_bytes() == b"x"


def test_a_missing_folder_is_refused_before_any_work(tmp_path: Path) -> None:
    """Oracle: the block never runs."""
    with (
        pytest.raises(OutputError, match=r"a\.ply: found no folder .*no, expected"),
        output_file(tmp_path / "no" / "a.ply"),
    ):
        pytest.fail("the block ran")


def test_a_folder_or_a_device_is_never_replaced(tmp_path: Path) -> None:
    """Oracle: /dev/null is still a device and the folder still a folder."""
    for target in (tmp_path, Path(os.devnull)):
        with (
            pytest.raises(OutputError, match=r"not a plain file|without write permission"),
            output_file(target),
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
        output_file(tmp_path / "a.ply"),
    ):
        pytest.fail("the block ran")


def test_a_full_disk_is_one_sentence_about_the_target(tmp_path: Path) -> None:
    """Oracle: ENOSPC as the kernel reports it, without a file name."""
    target = tmp_path / "a.ply"
    with (
        pytest.raises(OutputError, match=r"a\.ply: found No space left on device"),
        output_file(target) as made,
    ):
        made.path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert os.listdir(tmp_path) == []


def test_errors_about_other_files_pass_unchanged(tmp_path: Path) -> None:
    """Oracle: the very error that was raised, ours or the system's."""
    with pytest.raises(FileNotFoundError, match="other"), output_file(tmp_path / "a.ply"):
        (tmp_path / "other").read_bytes()
    with pytest.raises(FormatError, match=r"b\.spz"), output_file(tmp_path / "a.ply"):
        raise FormatError("b.spz", "nothing", "something")


def test_the_folder_of_a_temporary_file_is_private_and_announced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the calls of the hook, the mode of the folder, and the listing."""
    calls: list[tuple[str, bool, bool]] = []
    monkeypatch.setattr(
        output, "announce", lambda path, begins: calls.append((path, begins, os.path.exists(path)))
    )
    with output_file(tmp_path / "a.exr") as made:
        folder = made.path.parent
        assert folder.stat().st_mode & 0o777 == 0o700
        made.path.write_bytes(b"x")
        made.path.with_name("a.sibling.of.a.library").write_bytes(b"y")
    assert calls == [(str(folder), True, False), (str(folder), False, False)]
    assert os.listdir(tmp_path) == ["a.exr"]
    expected = tmp_path / "expected"
    expected.write_bytes(b"")
    assert (tmp_path / "a.exr").stat().st_mode == expected.stat().st_mode


def test_a_file_that_is_not_whole_does_not_replace_another(tmp_path: Path) -> None:
    """Oracle: the old bytes."""
    target = tmp_path / "a.exr"
    target.write_bytes(b"old")
    with (
        pytest.raises(OutputError, match=r"a\.exr: found a truncated file"),
        output_file(target, is_whole=lambda path: path.stat().st_size > 3) as made,
    ):
        made.path.write_bytes(b"new")
    assert target.read_bytes() == b"old"
    with pytest.raises(OutputError, match="truncated"), output_file(target):
        pass  # no file at all
    assert os.listdir(tmp_path) == [target.name]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_delayed_error_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """Oracle: EIO, as the kernel reports a failed delayed write, and the old bytes."""

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    target = tmp_path / "a.ply"
    target.write_bytes(b"old")
    with monkeypatch.context() as patch:
        patch.setattr(os, call, fail)
        with (
            pytest.raises(OutputError, match=r"a\.ply: found Input/output error"),
            output_file(target) as made,
        ):
            made.path.write_bytes(b"new")
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [target.name]


def test_a_name_that_is_not_utf_8_is_written(tmp_path: Path) -> None:
    """Oracle: the folder's listing in bytes; the temporary path is text that any library takes."""
    with output_file(os.fsdecode(os.fsencode(tmp_path) + b"/o\xfe.0001.exr")) as made:
        Path(made.text).write_bytes(b"x")
        assert made.path.name == "output.0001.exr"
    assert os.listdir(os.fsencode(tmp_path)) == [b"o\xfe.0001.exr"]
    (folder := Path(os.fsdecode(os.fsencode(tmp_path) + b"/f\xfe"))).mkdir()
    with pytest.raises(OutputError, match="not UTF-8"), output_file(folder / "a.exr") as made:
        made.text  # noqa: B018 - the property raises


def ended_process() -> int:
    """The number of a process that has ended."""
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    return ended.pid


def left_folder(beside: Path, process: int) -> Path:
    """Make what a process leaves that is killed while it writes."""
    folder = beside / f".usdsplat-{output._computer()}-{process}-0123abcd"
    folder.mkdir()
    (folder / "output.exr").write_bytes(b"half")
    return folder


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    """Oracle: a process that has ended, one that runs, and one of another computer."""
    ended = ended_process()
    left, ours = left_folder(tmp_path, ended), left_folder(tmp_path, os.getppid())
    elsewhere = tmp_path / f".usdsplat-00000000-{ended}-0123abcd"
    elsewhere.mkdir()
    kept = left / "earlier" / "shot.clips"
    kept.mkdir(parents=True)
    output.write_output(tmp_path / "a.exr", b"new")
    found = {ours.name, elsewhere.name, "a.exr", "shot.clips"}
    assert set(os.listdir(tmp_path)) == found


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_process_whose_parent_has_not_asked_for_its_status_has_ended() -> None:
    """Oracle: `os.waitid`, which waits for the end and leaves the process as it is."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        assert not output._has_ended(process.pid)
        process.kill()
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        assert output._has_ended(process.pid)


def test_a_group_appears_together(tmp_path: Path) -> None:
    """Oracle: the listing within and after the block."""
    with output_group() as group:
        output.write_output(tmp_path / "a.ply", b"a")
        with output_group():  # belongs to the first
            output.write_output(tmp_path / "b.ply", b"b")
        (tmp_path / "old.ply").write_bytes(b"")
        group.remove_later(tmp_path / "old.ply")
        assert not list(tmp_path.glob("[ab].ply")) and (tmp_path / "old.ply").exists()
    assert sorted(os.listdir(tmp_path)) == ["a.ply", "b.ply"]


@pytest.mark.parametrize("has_links", [True, False])
def test_a_group_that_fails_at_a_rename_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool
) -> None:
    """Oracle: the old bytes of what was replaced already, on file systems with and without hard
    links."""
    (tmp_path / "a.ply").write_bytes(b"old")
    (tmp_path / "c.clips").mkdir()
    (tmp_path / "c.clips" / "old").write_bytes(b"old")
    replace = os.replace

    def fails_at_d(source: Path, target: Path) -> None:
        if Path(target).name == "d.ply":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, target)

    monkeypatch.setattr(os, "replace", fails_at_d)
    if not has_links:
        monkeypatch.delattr(os, "link")
        monkeypatch.setattr(os, "link", lambda *_: fails_at_d(Path(), Path("d.ply")), raising=False)
    with pytest.raises(OutputError, match=r"d\.ply: found No space left"), output_group() as group:
        group.make_folder(tmp_path / "new")
        for name in ("a.ply", "b.ply"):
            output.write_output(tmp_path / name, b"new")
        with output_file(tmp_path / "d.ply") as made:
            made.path.write_bytes(b"new")
            (made.path.parent / "c.clips").mkdir()
            (made.path.parent / "c.clips" / "new").write_bytes(b"new")
            group.place_folder(made.path.parent / "c.clips", tmp_path / "c.clips")
    assert sorted(os.listdir(tmp_path)) == ["a.ply", "c.clips"]
    assert (tmp_path / "a.ply").read_bytes() == b"old"
    assert os.listdir(tmp_path / "c.clips") == ["old"]


def test_a_folder_of_a_group_replaces_an_earlier_one(tmp_path: Path) -> None:
    """Oracle: the listing of both folders."""
    (tmp_path / "c.clips").mkdir()
    (tmp_path / "c.clips" / "old").write_bytes(b"old")
    with output_group() as group, output_file(tmp_path / "a.usda") as made:
        made.path.write_bytes(b"new")
        (made.path.parent / "c.clips").mkdir()
        (made.path.parent / "c.clips" / "new").write_bytes(b"new")
        group.place_folder(made.path.parent / "c.clips", tmp_path / "c.clips")
    assert sorted(os.listdir(tmp_path)) == ["a.usda", "c.clips"]
    assert os.listdir(tmp_path / "c.clips") == ["new"]


@pytest.mark.parametrize("can_move", [True, False])
def test_an_earlier_file_that_cannot_be_put_back_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, can_move: bool
) -> None:
    """Oracle: the old bytes, in the folder that the message names; all renames fail from the second
    on, also those that undo the first, and that of the folder of earlier files."""
    (tmp_path / "a.ply").write_bytes(b"old")
    replace = os.replace

    def fails(source: Path, target: Path) -> None:
        is_rescue = Path(target).name.startswith("usdsplat-earlier-")
        is_first = Path(target).name == "a.ply" and Path(source).parent.name != "earlier"
        if not (is_first or (is_rescue and can_move)):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        replace(source, target)

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(OutputError, match="could not be put back are in") as caught, output_group():
        for name in ("a.ply", "b.ply"):
            output.write_output(tmp_path / name, b"new")
    folder = Path(caught.value.found.rpartition(" are in ")[2])
    assert (folder / "a.ply").read_bytes() == b"old"
    assert folder.parent == tmp_path if can_move else folder.parent.parent == tmp_path
    assert (tmp_path / "a.ply").read_bytes() == b"new"
    assert len(os.listdir(tmp_path)) == 2
