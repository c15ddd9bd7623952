"""Tests of the store of compiled kernels."""

from __future__ import annotations

import os
import threading

import pytest

from usdsplat.cli.main import main
from usdsplat.kernels import store

pytestmark = pytest.mark.usefixtures("folder")


def files(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


def test_what_is_kept_is_found(folder):
    """Oracle: the bytes that were given."""
    key = store.key_of("a", "b")
    assert key != store.key_of("ab", "") != store.key_of("a", "b", "")
    assert store.load(key) is None and not store.has(key)
    assert store.save(key, b"code")
    assert store.load(key) == b"code" and store.has(key)
    assert store.save(key, b"other code")
    assert store.load(key) == b"other code"
    assert len(files(folder)) == 1


@pytest.mark.parametrize("damage", [b"", b"x" * 31, b"x" * 500, None])
def test_a_damaged_entry_is_a_missing_one(folder, damage):
    """Oracle: files that were cut, overwritten, and changed in one bit."""
    key = store.key_of("kernel")
    store.save(key, b"code" * 100)
    (path,) = files(folder)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]) if damage is None else damage)
    assert store.load(key) is None
    assert store.save(key, b"code")
    assert store.load(key) == b"code"


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
def test_who_may_read_an_entry_is_the_umasks_to_say(folder):
    """Oracle: the file's mode: what root compiles into an image, a farm's user reads."""
    before = os.umask(0o022)
    try:
        store.save(store.key_of("kernel"), b"code")
    finally:
        os.umask(before)
    (path,) = files(folder)
    assert path.stat().st_mode & 0o777 == 0o644


def test_processes_that_start_together_do_not_meet(folder):
    """Oracle: whole entries at every moment, and nothing else left, with sixteen writers."""
    key, seen = store.key_of("kernel"), []

    def write(number: int) -> None:
        for _ in range(50):
            store.save(key, bytes([number]) * 10_000)
            seen.append(store.load(key))

    threads = [threading.Thread(target=write, args=(number,)) for number in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(data is not None and len(data) == 10_000 and len(set(data)) == 1 for data in seen)
    assert len(files(folder)) == 1


def test_a_folder_that_cannot_be_written_is_said(tmp_path, monkeypatch):
    """Oracle: a file in the place of the folder, and a home that is nowhere."""
    place = tmp_path / "file"
    place.write_text("")
    monkeypatch.setenv(store.VARIABLE, str(place))
    assert not store.save(store.key_of("kernel"), b"code")
    assert store.refusal() == f"{place}: not a directory"
    assert store.load(store.key_of("kernel")) is None
    monkeypatch.setattr(store, "folder", lambda: None)
    assert not store.save(store.key_of("kernel"), b"code")
    assert store.VARIABLE in store.refusal()


def test_a_command_says_that_nothing_is_kept(tmp_path, monkeypatch, capsys):
    """Oracle: the sentence, and the command's own status and output."""
    place = tmp_path / "file"
    place.write_text("")
    monkeypatch.setenv(store.VARIABLE, str(place))
    assert main(["--version"]) == 0
    assert capsys.readouterr().err == ""
    store.save(store.key_of("kernel"), b"code")
    assert main(["--version"]) == 0
    said = capsys.readouterr()
    assert said.out.startswith("usdsplat ")
    assert said.err == (
        f"usdsplat: compiled kernels: found {place}: not a directory, "
        "expected a folder that can be written\n"
    )


def test_the_users_cache_folder_is_the_platforms(tmp_path, monkeypatch):
    """Oracle: the XDG base directory specification."""
    monkeypatch.delenv(store.VARIABLE)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert store.folder() == tmp_path / "usdsplat" / "kernels"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert store.folder() == tmp_path / "home" / ".cache" / "usdsplat" / "kernels"
