"""Random damage to a splat tree: its table, the paths of its chunks, and their content."""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Vt

from tests.cli.conftest import ball
from tests.trees import authored, little_tree

Mutation = Callable[[random.Random, Path], None]

FOLDER = "tree_chunks"
COLUMNS = (
    "nodeLow", "nodeHigh", "nodeErrors", "nodeFirstChild", "nodeChildCount", "nodeChunk",
    "nodeFirstRow", "nodeProxies", "nodeResidents",
)  # fmt: skip
WHOLE = (0, -1, 1, 2, 3, 6, 7, 100, 2**31 - 1, -(2**31), 2**40, 2**62, -(2**63))
REAL = (0.0, -1.0, 0.05, 1e-30, 1e30, 3.4e38, float("inf"), float("-inf"), float("nan"))
PATHS = (
    "", ".", "..", "/", "./tree.usda", "./tree_chunks", "./tree_chunks/none.usdc", "/dev/null",
    "/dev/zero", "./tree_chunks/0000.usdc", "./tree_chunks/0001.usdc", "./tree_chunks/pipe.usdc",
    "./tree_chunks/0002.usdc[0.usdc]", "./none.usdz[a.usdc]", "http://localhost/a.usdc", "é" * 300,
    "a[b]", "anon:0x1:a", "./tree_chunks/0002.usdc:SDF_FORMAT_ARGS:a=b", "x" * 5000, "./ball.ply",
)  # fmt: skip
ARRAYS = (
    "positions", "splat:packed", "splat:colorRange", "splat:packedHarmonics",
    "splat:harmonicsRange",
)  # fmt: skip
OTHERS: tuple[tuple[str, Any], ...] = (
    ("splat:lod:pixel", float("nan")), ("splat:lod:pixel", -1.0), ("splat:lod:pixel", 1e30),
    ("splat:sampling:footprint", -2.0), ("radiance:sphericalHarmonicsDegree", 9),
    ("radiance:sphericalHarmonicsDegree", 3), ("colorSpace:name", "nonsense"),
    ("splat:chunks", 3.0), ("extent", Vt.Vec3fArray(1)), ("visibility", "nonsense"),
)  # fmt: skip


def mutated_tree(seed: int, folder: Path) -> Path:
    """Write a valid tree with one to three mistakes to an empty folder, and return its path."""
    rng = random.Random(seed)
    path = little_tree(folder, ball(120), form="float" if seed % 4 == 3 else "packed")
    for number in range(rng.choice((1, 1, 2, 3))):
        which = seed if number == 0 else rng.randrange(len(MUTATIONS))
        MUTATIONS[which % len(MUTATIONS)](rng, path)
    return path


# --- mutations -----------------------------------------------------------------------------------


def _column(path: Path, name: str) -> Any:
    layer = Sdf.Layer.FindOrOpen(str(path))
    return layer.GetAttributeAtPath(f"/tree/splats.splat:{name}").default


def change_numbers(rng: random.Random, path: Path) -> None:
    """Replace some numbers of a column."""
    name = rng.choice(COLUMNS)
    before = _column(path, name)
    numbers = np.array(before)
    for _ in range(rng.choice((1, 1, 2, len(numbers)))):
        choices = REAL if numbers.dtype == np.float32 else WHOLE
        row = rng.randrange(len(numbers)) if len(numbers) else 0
        if len(numbers):
            with np.errstate(all="ignore"):
                numbers[row] = np.asarray(rng.choice(choices)).astype(numbers.dtype)
    authored(path, "/tree/splats", f"splat:{name}", type(before).FromNumpy(numbers))


def exchange_numbers(rng: random.Random, path: Path) -> None:
    """Exchange two numbers of a column: links that cross, rows that overlap, boxes elsewhere."""
    name = rng.choice(COLUMNS)
    before = _column(path, name)
    numbers = np.array(before)
    if len(numbers) > 1:
        a, b = rng.sample(range(len(numbers)), 2)
        numbers[[a, b]] = numbers[[b, a]]
    authored(path, "/tree/splats", f"splat:{name}", type(before).FromNumpy(numbers))


def change_length(rng: random.Random, path: Path) -> None:
    """Shorten or extend one column, or all."""
    names = COLUMNS if rng.random() < 0.3 else (rng.choice(COLUMNS),)
    length = rng.choice((0, 1, 6, 8, 1000, 200_000))
    for name in names:
        before = _column(path, name)
        numbers = np.array(before)
        resized = np.resize(numbers, (length, *numbers.shape[1:]))
        authored(path, "/tree/splats", f"splat:{name}", type(before).FromNumpy(resized))


def change_type(rng: random.Random, path: Path) -> None:
    """Replace a column by one of another type, or block it."""
    name = f"splat:{rng.choice(COLUMNS)}"
    values = (Vt.IntArray(7), Vt.FloatArray(7), Vt.Int64Array(7), Vt.StringArray(7), 1.0, "a")
    authored(path, "/tree/splats", name, rng.choice((*values, Vt.Vec3dArray(7), Vt.BoolArray(7))))


def change_other(rng: random.Random, path: Path) -> None:
    """Replace another attribute of the tree."""
    authored(path, "/tree/splats", *rng.choice(OTHERS))


def change_paths(rng: random.Random, path: Path) -> None:
    """Replace the path of a chunk, or all paths."""
    if hasattr(os, "mkfifo") and not (pipe := path.parent / FOLDER / "pipe.usdc").exists():
        os.mkfifo(pipe)
    layer = Sdf.Layer.FindOrOpen(str(path))
    found = layer.GetAttributeAtPath("/tree/splats.splat:chunks").default
    paths = [each.path for each in found] if isinstance(found, Sdf.AssetPathArray) else []
    if rng.random() < 0.2:
        paths = [rng.choice(PATHS)] * rng.choice((0, 1, 4, 3000))
    elif paths:
        paths[rng.randrange(len(paths))] = rng.choice(PATHS)
    value = Sdf.AssetPathArray([Sdf.AssetPath(each) for each in paths])
    authored(path, "/tree/splats", "splat:chunks", value)


def _chunk(rng: random.Random, path: Path) -> Path:
    return path.parent / FOLDER / f"000{rng.randrange(3)}.usdc"


def _opened(chunk: Path) -> Sdf.Layer | None:
    """The layer of a chunk that still has its prim."""
    try:
        layer = Sdf.Layer.FindOrOpen(str(chunk)) if chunk.is_file() else None
    except Tf.ErrorException:
        return None
    return layer if layer and layer.GetPrimAtPath("/chunk") else None


def remove_chunk(rng: random.Random, path: Path) -> None:
    """Remove a chunk, or put another file or a folder in its place."""
    chunk = _chunk(rng, path)
    chunk.unlink(missing_ok=True)
    which = rng.randrange(4)
    if which == 1:
        shutil.copy(path, chunk)
    elif which == 2:
        chunk.write_bytes(rng.randbytes(5000))
    elif which == 3:
        chunk.write_text(
            '#usda 1.0\n( defaultPrim = "a" )\ndef "a" ( references = @./0000.usdc@ ) {}'
        )


def change_array(rng: random.Random, path: Path) -> None:
    """Replace an array of a chunk: another length or type, or numbers that are not finite."""
    chunk, name = _chunk(rng, path), rng.choice((*ARRAYS, "scales", "orientations", "opacities"))
    if (layer := _opened(chunk)) is None:
        return
    lengths = (0, 1, 7, 30, 100_000)
    kinds = (Vt.Vec3fArray, Vt.Vec4iArray, Vt.FloatArray, Vt.QuatfArray, Vt.Vec2dArray)
    value: Any = rng.choice(kinds)(rng.choice(lengths))
    before = layer.GetAttributeAtPath(f"/chunk.{name}")
    if before and before.default is not None and rng.random() < 0.6:
        numbers = np.array(before.default)
        if numbers.size and numbers.dtype == np.float32:
            numbers[rng.randrange(len(numbers))] = rng.choice(REAL)
        value = type(before.default).FromNumpy(np.resize(numbers, numbers.shape))
    authored(chunk, "/chunk", name, value)


def change_prim(rng: random.Random, path: Path) -> None:
    """Change the prim of a chunk: its type, its name, its degree or its packing."""
    chunk = _chunk(rng, path)
    if (layer := _opened(chunk)) is None:
        return
    prim = layer.GetPrimAtPath("/chunk")
    which = rng.randrange(5)
    if which == 0:
        prim.typeName = rng.choice(("", "Mesh", "ParticleFieldSplatTree", "SplatSim"))
    elif which == 1:
        layer.defaultPrim = rng.choice(("", "none", "/chunk/a", "a b"))
    elif which == 2:
        prim.typeName = "ParticleField3DGaussianSplat"
    elif which == 3:
        name, value = "radiance:sphericalHarmonicsDegree", rng.choice((-1, 0, 2, 4, 9))
        authored(chunk, "/chunk", name, value)
    else:
        authored(chunk, "/chunk", "splat:packing", rng.choice(("", "other")))
    layer.Save()


def flip_bytes(rng: random.Random, path: Path) -> None:
    """Replace some bytes of a chunk, cut it, or fill a part with zeros."""
    chunk = _chunk(rng, path)
    if not chunk.is_file() or not chunk.stat().st_size:
        return
    data = bytearray(chunk.read_bytes())
    which = rng.randrange(4)
    if which == 0:
        del data[rng.randrange(len(data)) :]
    elif which == 1:
        at = rng.randrange(len(data))
        data[at : at + 64] = bytes(len(data[at : at + 64]))
    else:
        for _ in range(rng.choice((1, 3, 20))):
            data[rng.randrange(len(data))] = rng.randrange(256)
    chunk.unlink()
    chunk.write_bytes(data)


def fill_memory(rng: random.Random, path: Path) -> None:
    """Give a chunk an array of equal numbers that takes much more memory than the file."""
    chunk = _chunk(rng, path)
    if _opened(chunk) is not None:
        name = rng.choice(("ids", "splat:harmonicsRange", "opacities", "widths", "splat:unknown"))
        kind = rng.choice((Vt.Int64Array, Vt.FloatArray, Vt.IntArray))
        authored(chunk, "/chunk", name, kind(40_000_000))


MUTATIONS: tuple[Mutation, ...] = (
    change_numbers, exchange_numbers, change_length, change_type, change_other, change_paths,
    remove_chunk, change_array, change_prim, flip_bytes, change_numbers, change_paths, flip_bytes,
    fill_memory,
)  # fmt: skip
