"""Tests of what a bake that fails leaves of an earlier one."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from tests.sim.stage.bakes import shot
from usdsplat.core.errors import OutputError
from usdsplat.sim.stage import bake_layers


def files(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, byte by byte."""
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def test_a_bake_that_cannot_begin_leaves_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the bytes of all files before; the folder of samples cannot be changed, and has a
    frame that an earlier simulation left."""
    again = shot(tmp_path, lives=False, count=3)
    again.run()
    (tmp_path / "bake_data" / "00.1.frame").write_bytes(b"left")
    before, unlink = files(tmp_path), Path.unlink

    def refuse(path: Path, missing_ok: bool = False) -> None:
        if path.parent.name == "bake_data":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(PermissionError):
        again.run()
    assert files(tmp_path) == before


def test_a_named_layer_that_was_not_replaced_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the bytes of the named layer; the samples are removed when a bake begins, and the
    disk is full before the first layer of the new one is written."""
    again = shot(tmp_path, lives=False, count=3)
    again.run()
    before = again.target.read_bytes()

    def full(*_: object) -> None:
        raise OutputError("bake.usda", "No space left on device", "more space")

    monkeypatch.setattr(bake_layers, "export_layer", full)
    with pytest.raises(OutputError, match="No space left"):
        again.run()
    assert again.target.read_bytes() == before
    assert not (tmp_path / "bake_data").exists()


def test_a_bake_without_a_checkpoint_leaves_nothing(tmp_path: Path) -> None:
    """Oracle: the listing: only the stage that is simulated."""

    def stop(event: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shot(tmp_path, lives=False, count=3).run(stop=stop)
    assert set(files(tmp_path)) == {"shot.usda"}
    assert not (tmp_path / "bake_data").exists()
