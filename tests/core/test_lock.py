"""Tests of locks of outputs."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from usdsplat.core.errors import OutputError
from usdsplat.core.lock import output_lock

HOLD = """
import sys
from usdsplat.core.lock import output_lock
with output_lock(sys.argv[1]):
    print("holds", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_refused_in_one_sentence(tmp_path: Path) -> None:
    """Oracle: the number of the process that holds the lock; after it is killed, the lock is free,
    and its file is removed by the next one."""
    target = tmp_path / "bake.usda"
    command = [sys.executable, "-c", textwrap.dedent(HOLD), str(target)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"holds\n"
        with (
            pytest.raises(OutputError, match=rf"bake\.usda: found .*process {process.pid} is"),
            output_lock(target),
        ):
            pytest.fail("the block ran")
        process.kill()
    assert os.listdir(tmp_path) == [".bake.usda.lock"]
    with output_lock(target):
        assert os.listdir(tmp_path) == [".bake.usda.lock"]
    assert os.listdir(tmp_path) == []


def test_two_threads_are_two_writers(tmp_path: Path) -> None:
    """Oracle: this process's own number; the lock of another target is free."""
    with (
        output_lock(tmp_path / "a.usda"),
        output_lock(tmp_path / "b.usda"),
        pytest.raises(OutputError, match=f"process {os.getpid()} is writing"),
        output_lock(tmp_path / "a.usda"),
    ):
        pytest.fail("the block ran")


def test_a_folder_that_cannot_be_written_is_left_to_the_writer(tmp_path: Path) -> None:
    """Oracle: the block runs."""
    with output_lock(tmp_path / "no" / "a.usda"):
        assert not (tmp_path / "no").exists()


@pytest.mark.parametrize("call", ["ftruncate", "write"])
def test_an_interrupt_while_locking_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """Oracle: the listing, and a lock that is free afterwards."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, call, interrupt)
        with pytest.raises(KeyboardInterrupt), output_lock(tmp_path / "a.usda"):
            pytest.fail("the block ran")
    assert os.listdir(tmp_path) == []
    with output_lock(tmp_path / "a.usda"):
        pass


def test_a_file_system_without_locks_has_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: ENOLCK, as network file systems report it; the block runs, and no file is left."""

    def fail(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", fail)
    with output_lock(tmp_path / "a.usda"):
        assert os.listdir(tmp_path) == []


def test_every_user_may_open_the_lock(tmp_path: Path) -> None:
    """Oracle: the mode of the file, whatever the umask; a lock that nobody else could open once
    let another user's process write the same output."""
    before = os.umask(0o077)
    try:
        with output_lock(tmp_path / "a.usda"):
            assert (tmp_path / ".a.usda.lock").stat().st_mode & 0o777 == 0o666
    finally:
        os.umask(before)


def test_a_lock_that_cannot_be_written_counts_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: EACCES, as the kernel reports it to other users, of files and of the folder."""
    real, refused = os.open, os.O_RDWR

    def denied(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & refused or refused == os.O_RDONLY:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return real(path, flags, mode)

    target = tmp_path / "a.usda"
    with output_lock(target), monkeypatch.context() as patch:
        patch.setattr(os, "open", denied)
        with (
            pytest.raises(OutputError, match=f"process {os.getpid()} is writing"),
            output_lock(target),
        ):
            pytest.fail("the block ran")
        refused = os.O_RDONLY
        with (
            pytest.raises(OutputError, match=r"found \.a\.usda\.lock, the lock of another user"),
            output_lock(target),
        ):
            pytest.fail("the block ran")
    (tmp_path / ".b.usda.lock").write_text("1 elsewhere")
    refused = os.O_RDWR
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", denied)
        with output_lock(tmp_path / "b.usda"):
            assert (tmp_path / ".b.usda.lock").read_text() == "1 elsewhere"
        assert os.listdir(tmp_path) == []
        with output_lock(tmp_path / "c.usda"):  # in a folder where no file can be made
            assert os.listdir(tmp_path) == []


def test_a_link_in_place_of_the_lock_is_refused(tmp_path: Path) -> None:
    """Oracle: content and mode of the file that the link leads to, as they were before."""
    private = tmp_path / "private"
    private.write_text("content")
    private.chmod(0o600)
    (tmp_path / ".a.usda.lock").symlink_to("private")
    with (
        pytest.raises(OutputError, match=r"found \.a\.usda\.lock, a symbolic link"),
        output_lock(tmp_path / "a.usda"),
    ):
        pytest.fail("the block ran")
    assert (private.read_text(), private.stat().st_mode & 0o777) == ("content", 0o600)


def test_a_second_name_of_a_file_is_locked_and_not_written(tmp_path: Path) -> None:
    """Oracle: content and mode of the file; a second writer is refused while it is locked."""
    private = tmp_path / "private"
    private.write_text("content")
    private.chmod(0o600)
    (tmp_path / ".a.usda.lock").hardlink_to(private)
    with output_lock(tmp_path / "a.usda"):
        assert (private.read_text(), private.stat().st_mode & 0o777) == ("content", 0o600)
        with pytest.raises(OutputError, match="is writing"), output_lock(tmp_path / "a.usda"):
            pytest.fail("the block ran")
    assert os.listdir(tmp_path) == ["private"]


def test_a_lock_that_is_removed_while_it_is_opened_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: a lock in the block; its owner removes it after this process was refused to write,
    and before it opens it to read."""
    path = tmp_path / ".a.usda.lock"
    path.write_text("1 elsewhere")
    real = os.open

    def denied(name: Path, flags: int, mode: int = 0o777) -> int:
        if flags & os.O_RDWR and path.exists():
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(name))
        path.unlink(missing_ok=True)
        return real(name, flags, mode)

    monkeypatch.setattr(os, "open", denied)
    with output_lock(tmp_path / "a.usda"):
        assert path.read_text().startswith(f"{os.getpid()} ")
