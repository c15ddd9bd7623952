"""Tests of the check for small crate files with arrays that fill the memory."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, UsdUtils, Vt

from tests.schema.clouds import cloud
from tests.trees import authored, little_tree, tree_of, write_chunk
from usdsplat.core.errors import StageError
from usdsplat.schema.chunks import chunk_shape, read_chunk
from usdsplat.schema.crate_arrays import RATIO, TRUSTED, check_arrays
from usdsplat.schema.usd_files import MOST_TEXT

LONG = 20_000_000


@pytest.mark.parametrize("form", ["packed", "float"])
@pytest.mark.parametrize("degree", [0, 4])
def test_chunks_pass(tmp_path: Path, form, degree: int) -> None:
    """Oracle: files that our own code wrote."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=5000, degree=degree), form=form)
    check_arrays(str(path), is_chunk=True)


@pytest.mark.parametrize("name", ["ids", "splat:harmonicsRange", "opacities"])
def test_a_bomb_in_a_chunk_is_one_sentence(tmp_path: Path, name: str) -> None:
    """Oracle: the bytes that Python allocated, and a file 100 times smaller than its array."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=50))
    array = Vt.Int64Array(LONG) if name == "ids" else Vt.FloatArray(LONG)
    authored(path, "/chunk", name, array)
    assert path.stat().st_size < 4 * LONG / 100
    for read in (read_chunk, chunk_shape):
        with pytest.raises(StageError, match=f"found an array of {LONG} numbers in") as raised:
            read(str(path))
        assert "\n" not in str(raised.value)


def test_a_bomb_in_a_table_is_one_sentence(tmp_path: Path) -> None:
    """Oracle: the length that was written, also in a package."""
    path = little_tree(tmp_path, cloud(n=200))
    crate = tmp_path / "tree.usdc"
    Sdf.Layer.FindOrOpen(str(path)).Export(str(crate))
    authored(crate, "/tree/splats", "splat:nodeChunk", Vt.IntArray(LONG))
    with pytest.raises(StageError, match=f"found an array of {LONG} numbers in"):
        tree_of(crate)
    package = tmp_path / "tree.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(crate), str(package))
    with pytest.raises(StageError, match=f"found an array of {LONG} numbers in"):
        tree_of(package)


def test_long_arrays_beside_as_many_vectors_pass(tmp_path: Path) -> None:
    """Oracle: a field of equal opacities, whose array is compressed."""
    path = tmp_path / "field.usdc"
    layer = Sdf.Layer.CreateNew(str(path))
    prim = Sdf.CreatePrimInLayer(layer, "/A")
    count = TRUSTED + 1
    for name, value in (("opacities", Vt.FloatArray(count)), ("points", Vt.Vec3fArray(count))):
        Sdf.AttributeSpec(prim, name, Sdf.GetValueTypeNameForValue(value)).default = value
    layer.Save()
    check_arrays(str(path), is_chunk=False)


@pytest.mark.parametrize("over", [0, 1])
def test_the_limit_is_exact(tmp_path: Path, over: int) -> None:
    """Oracle: RATIO times the stored array, and one more."""
    path = tmp_path / "field.usdc"
    layer = Sdf.Layer.CreateNew(str(path))
    prim = Sdf.CreatePrimInLayer(layer, "/A")
    rows = TRUSTED // RATIO + 10
    for name, value in (
        ("opacities", Vt.FloatArray(RATIO * rows + over)),
        ("points", Vt.Vec3fArray(rows)),
    ):
        Sdf.AttributeSpec(prim, name, Sdf.GetValueTypeNameForValue(value)).default = value
    layer.Save()
    if over:
        with pytest.raises(StageError):
            check_arrays(str(path), is_chunk=False)
    else:
        check_arrays(str(path), is_chunk=False)


def test_layers_of_many_values_pass_unless_they_are_chunks(tmp_path: Path) -> None:
    """Oracle: the number of different values in the layer."""
    path = tmp_path / "many.usdc"
    layer = Sdf.Layer.CreateNew(str(path))
    with Sdf.ChangeBlock():
        prim = Sdf.CreatePrimInLayer(layer, "/A")
        for number in range(70_000):
            Sdf.AttributeSpec(prim, f"a{number}", Sdf.ValueTypeNames.Int).default = number
    layer.Save()
    check_arrays(str(path), is_chunk=False)
    with pytest.raises(StageError, match="more than 65536 values, expected a layer with one field"):
        check_arrays(str(path), is_chunk=True)


def test_other_files_and_layers_in_memory_pass(tmp_path: Path) -> None:
    """Oracle: they are no crate files; USD refuses them itself."""
    (tmp_path / "text.usda").write_text("#usda 1.0\n")
    (tmp_path / "short.usdc").write_bytes(b"PXR-USDC")
    for name in ("text.usda", "short.usdc", "gone.usdc"):
        check_arrays(str(tmp_path / name), is_chunk=True)
    check_arrays("anon:0x1:chunk.usda", is_chunk=True)


def test_damaged_files_are_read_or_one_sentence_without_memory(tmp_path: Path) -> None:
    """Oracle: random bytes changed in a chunk; the bytes that Python allocated."""
    path, wrong = tmp_path / "chunk.usdc", tmp_path / "wrong.usdc"
    write_chunk(path, cloud(n=20))
    whole = np.frombuffer(path.read_bytes(), np.uint8)
    rng = np.random.default_rng(3)
    refused = 0
    tracemalloc.start()
    for _ in range(300):
        data = whole.copy()
        start = 0 if rng.random() < 0.3 else len(data) - 2000
        places = rng.integers(start, len(data), rng.integers(1, 5))
        data[places] = rng.integers(0, 256, len(places))
        wrong.write_bytes(data.tobytes()[: None if rng.random() < 0.8 else rng.integers(len(data))])
        try:
            check_arrays(str(wrong), is_chunk=True)
        except StageError as error:
            refused += 1
            assert "\n" not in str(error)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()
    assert refused > 10


def test_a_count_in_a_header_allocates_nothing(tmp_path: Path) -> None:
    """Oracle: an array that claims 2^40 rows in a small file; USD says so, not the allocator."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=777), form="packed")
    data = path.read_bytes()
    count = struct.pack("<Q", 777)
    assert data.count(count) >= 2
    path.write_bytes(data.replace(count, struct.pack("<Q", 1 << 40)))
    with pytest.raises(StageError, match="expected"):
        read_chunk(str(path))


@pytest.mark.parametrize("section", [b"TOKENS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS"])
def test_a_section_that_claims_many_entries_is_one_sentence(tmp_path: Path, section: bytes) -> None:
    """Oracle: the number that was written, for which USD would allocate memory."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=20))
    data = bytearray(path.read_bytes())
    start = struct.unpack_from("<q", data, data.index(section + b"\0") + 16)[0]
    struct.pack_into("<Q", data, start, 1 << 22)
    path.write_bytes(data)
    with pytest.raises(StageError, match="more than 65536 values"):
        read_chunk(str(path))


def test_a_message_of_usd_is_cut(tmp_path: Path) -> None:
    """Oracle: a chunk with thousands of broken values, each of which USD names."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=20))
    data = bytearray(path.read_bytes())
    start = struct.unpack_from("<q", data, data.index(b"SPECS\0") + 16)[0]
    struct.pack_into("<Q", data, start, 1 << 15)
    path.write_bytes(data)
    with pytest.raises(StageError, match=r"^.* \.\.\., expected") as raised:
        read_chunk(str(path))
    assert len(str(raised.value)) < MOST_TEXT + 200
