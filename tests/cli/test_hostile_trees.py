"""Tests of lying and malicious splat trees on the command line, each in a separate process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Vt

from tests.cli.converting import convert_each
from tests.cli.test_hostile import check_refused
from tests.cli.tree_mutations import mutated_tree
from tests.formats.reading import MEMORY_LIMIT_MB, linux_only
from tests.schema.clouds import cloud
from tests.slowness import slowness
from tests.trees import authored, changed, little_tree, write_chunk

FEW, MANY = 56, 200
"""Damaged trees."""
LONGEST = 2.0
"""Processor time of a command on a usual machine [s]."""
LONG = 60_000_000
"""Length of arrays of equal numbers, which a crate file stores in 100 kB."""


def column(name: str, node: int, value: int | float) -> Callable[[Path], None]:
    """Return a change of one number of the table."""

    def change(path: Path) -> None:
        layer = Sdf.Layer.FindOrOpen(str(path))
        before = layer.GetAttributeAtPath(f"/tree/splats.splat:{name}").default
        numbers = np.array(before)
        numbers[node] = value
        changed(path, f"splat:{name}", type(before).FromNumpy(numbers))

    return change


def whole(name: str, value: Any) -> Callable[[Path], None]:
    """Return a change of a whole array of the table."""
    return lambda path: changed(path, f"splat:{name}", value)


def with_digests(value: Any) -> Callable[[Path], None]:
    """Return the addition of digests of the chunks."""
    return lambda path: authored(path, "/tree/splats", "splat:chunkDigests", value)


def chunk_array(name: str, value: Any) -> Callable[[Path], None]:
    """Return a change of an array of the leaves' chunk."""
    chunk = Path("tree_chunks", "0002.usdc")
    return lambda path: authored(path.parent / chunk, "/chunk", name, value)


def chunk_bytes(edit: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    """Return a change of the bytes of the leaves' chunk."""

    def change(path: Path) -> None:
        chunk = path.parent / "tree_chunks" / "0002.usdc"
        data = edit(chunk.read_bytes())
        chunk.unlink()
        chunk.write_bytes(data)

    return change


def with_another_chunk(path: Path) -> None:
    """Replace the leaves' chunk by a shorter one."""
    chunk = path.parent / "tree_chunks" / "0002.usdc"
    chunk.unlink()
    write_chunk(chunk, cloud(n=150, degree=1))


def as_crate(path: Path) -> None:
    """Replace the text of the stage by a crate file with an array that fills the memory."""
    crate = path.with_name("crate.usdc")
    Sdf.Layer.FindOrOpen(str(path)).Export(str(crate))
    changed(crate, "splat:nodeResidents", Vt.Int64Array(LONG))
    path.unlink()
    crate.rename(path.with_suffix(".usd"))


LIES: dict[str, Callable[[Path], None]] = {
    "cycle": column("nodeFirstChild", 1, 0),
    "own child": column("nodeFirstChild", 2, 2),
    "many children": column("nodeChildCount", 0, 2**31 - 1),
    "far rows": column("nodeFirstRow", 3, 2**40),
    "many splats": column("nodeProxies", 6, 2**40),
    "too many splats": column("nodeProxies", 6, 2**62),
    "negative": column("nodeResidents", 4, -5),
    "overlap": column("nodeFirstRow", 5, 3),
    "no number": column("nodeErrors", 1, float("nan")),
    "growing error": column("nodeErrors", 0, 0.1),
    "box": column("nodeHigh", 3, 9e9),
    "chunk": column("nodeChunk", 3, 99),
    "empty": whole("nodeErrors", Vt.FloatArray()),
    "long": whole("nodeChunk", Vt.IntArray(100_000)),
    "digests": with_digests(Vt.StringArray(["0", "1", "2"])),
    "many digests": with_digests(Vt.StringArray(1_000_000)),
    "digests of no text": with_digests(Vt.IntArray(3)),
    "bomb in the table": as_crate,
    "bomb of ids": chunk_array("ids", Vt.Int64Array(LONG)),
    "bomb of a range": chunk_array("splat:harmonicsRange", Vt.FloatArray(LONG)),
    "short array": chunk_array("splat:packed", Vt.Vec4iArray(100)),
    "short chunk": with_another_chunk,
    "cut chunk": chunk_bytes(lambda data: data[: len(data) // 2]),
    "empty chunk": chunk_bytes(lambda data: b""),
    "noise": chunk_bytes(lambda data: data[:88] + bytes(range(256)) * 8),
}
"""Name -> what is wrong."""


@linux_only
def test_every_lie_and_every_bomb_is_one_sentence(tmp_path: Path) -> None:
    """Oracle: the contract of errors, and the memory that the system counted."""
    pairs = []
    for number, lie in enumerate(LIES.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = little_tree(folder, cloud(n=200, degree=1))
        lie(path)
        source = path if path.exists() else path.with_suffix(".usd")
        pairs.append((source, folder / "out.ply"))
    done = convert_each(pairs)
    assert len(done) == len(LIES)
    for each in done:
        each.said[:] = [line for line in each.said if "[unsupported-prim]" not in line]
        check_refused(each)


def damaged(folder: Path, count: int) -> list[Path]:
    """Trees with random mistakes."""
    paths = []
    for seed in range(count):
        (folder / str(seed)).mkdir()
        paths.append(mutated_tree(seed, folder / str(seed)))
    return paths


def check_converted(folder: Path, count: int) -> None:
    """Damaged trees are a capture or one sentence, in little time and memory."""
    done = convert_each((path, path.with_name("out.ply")) for path in damaged(folder, count))
    assert len(done) == count
    slow = slowness()
    for each in done:
        assert each.seconds < LONGEST * slow, each
        each.said[:] = [line for line in each.said if "[unsupported-prim]" not in line]
        if each.status:
            check_refused(each)
        assert each.peak < MEMORY_LIMIT_MB and (each.status == 0) == Path(each.target).exists()
    assert count / 10 < sum(each.status == 0 for each in done) < count / 2


@linux_only
def test_damaged_trees_are_a_capture_or_one_sentence(tmp_path: Path) -> None:
    """Oracle: the contract of errors; time and memory that the system counted."""
    check_converted(tmp_path, FEW)


@linux_only
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_two_hundred_damaged_trees_are_a_capture_or_one_sentence(tmp_path: Path) -> None:
    """Oracle: as above."""
    check_converted(tmp_path, MANY)


@linux_only
@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("command", ["render", "validate"])
def test_two_hundred_damaged_trees_are_drawn_with_findings(tmp_path: Path, command: str) -> None:
    """Oracle: the contract of findings: `validate` ends with status 1 for an error and `render`
    draws what is left; time and memory that the system counted."""
    words = {"render": "render {} -o {} --resolution 32x24 --device cpu", "validate": "validate {}"}
    paths = damaged(tmp_path, MANY)
    done = convert_each([(path, path.with_name("out.png")) for path in paths], words[command])
    assert len(done) == MANY
    slow = slowness()
    for each in done:
        assert each.status in (0, 1) and not any("Traceback" in line for line in each.said), each
        assert each.seconds < LONGEST * slow and each.peak < MEMORY_LIMIT_MB, each
        assert Path(each.target).exists() == (command == "render"), each
