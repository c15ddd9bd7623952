"""Fuzz test of pictures and OCIO configurations that a command reads, in this process."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import PyOpenColorIO as ocio
import pytest

SMALL = ("--resolution", "16x12", "--threads", "1")
STATUSES = {0, 2}
SEVERAL = 5
"""Files of one test."""


def write_exr(path: Path, names: tuple[str, ...]) -> None:
    """Write a picture with noise in these channels."""
    spec = oiio.ImageSpec(16, 12, len(names), "float")
    spec.channelnames = names
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    pixels = np.random.default_rng(0).random((12, 16, len(names)), np.float32)
    assert file.write_image(pixels)
    file.close()


def write_config(path: Path) -> None:
    """Write OpenColorIO's own raw configuration."""
    path.write_text(ocio.Config.CreateRaw().serialize(), encoding="utf-8")


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Change, remove, repeat or cut off bytes; early ones, those of a header, more often."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = min(int(rng.expovariate(4 / len(data))), len(changed) - 1)
        match rng.randrange(5):
            case 0:
                changed[at] = rng.randrange(256)
            case 1:
                changed[at : at + 4] = rng.choice((b"\0\0\0\0", b"\xff" * 4, b"\xff\xff\xff\x7f"))
            case 2:
                del changed[at : at + rng.randint(1, 16)]
            case 3:
                changed[at:at] = changed[at : at + rng.randint(1, 16)]
            case 4:
                del changed[at + 1 :]
    return bytes(changed)


def holdout(shot: Path, given: Path, out: Path) -> tuple[object, ...]:
    """Render in front of a picture with depth."""
    return ("render", shot, "-o", out / "a.exr", *SMALL, "--holdout", given)


def plate(shot: Path, given: Path, out: Path) -> tuple[object, ...]:
    """Match splats to a picture."""
    return ("match", shot, "--reference", given, "-o", out / "a.usda", "--threads", "1")


def config(shot: Path, given: Path, out: Path) -> tuple[object, ...]:
    """Render through a view of a configuration."""
    view = ("--color-mode", "inverseView", "--config", given)
    return ("render", shot, "-o", out / "a.exr", *SMALL, *view)


KINDS: dict[str, tuple[Callable[[Path], None], Callable[..., tuple[object, ...]], str]] = {
    "holdout": (lambda path: write_exr(path, ("R", "G", "B", "A", "Z")), holdout, ".exr"),
    "plate": (lambda path: write_exr(path, ("R", "G", "B")), plate, ".exr"),
    "config": (write_config, config, ".ocio"),
}


def check(kind: str, seed: int, shot: Path, folder: Path, run) -> None:
    """Run a command on mutated files, and check status, stderr and the folder after each."""
    write, command, suffix = KINDS[kind]
    rng = random.Random(f"{kind} {seed}")
    good, given, out = folder / f"good{suffix}", folder / f"given{suffix}", folder / "out"
    out.mkdir()
    write(good)
    for _ in range(SEVERAL):
        given.write_bytes(mutated(rng, good.read_bytes()))
        status, _, err = run(*command(shot, given, out))
        assert status in STATUSES, err
        if status == 2:
            last = err.splitlines()[-1]
            assert last.startswith("usdsplat: ") and last.isprintable(), err
        assert "Traceback" not in err
        assert [path.name for path in out.rglob(".*")] == []
        for path in (*out.iterdir(),):
            assert status == 0, "a result beside an error"
            path.unlink()


@pytest.mark.parametrize("kind", KINDS)
def test_a_mutated_input_ends_with_a_documented_status(kind, shot, tmp_path, run):
    """Oracle: status 0 or 2; a printable sentence on stderr; no result and no hidden file beside an
    error."""
    check(kind, 0, shot, tmp_path, run)


@pytest.mark.slow
@pytest.mark.wrong_stages
@pytest.mark.parametrize("seed", range(1, 34))
@pytest.mark.parametrize("kind", KINDS)
def test_further_mutated_inputs_end_with_a_documented_status(kind, seed, shot, tmp_path, run):
    """Oracle: as above, for 165 files of each kind."""
    check(kind, seed, shot, tmp_path, run)
