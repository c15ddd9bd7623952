"""Tests of reading the chunks of a splat tree."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt

from tests.schema.clouds import cloud
from tests.trees import rows_of, write_chunk
from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.schema import packing
from usdsplat.schema.chunks import chunk_shape, read_chunk, read_packed_chunk

ARRAYS = ("positions", "scales", "rotations", "opacities", "sh")


def field_of(path: Path) -> Any:
    """The cloud of a chunk, read by `fetch` from a stage."""
    stage = Usd.Stage.Open(str(path))
    return schema.fetch(stage.GetDefaultPrim())


def same(ours: Any, other: Any) -> None:
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(ours, name), getattr(other, name), name)


@pytest.mark.parametrize("degree", range(5))
@pytest.mark.parametrize("form", ["packed", "float"])
def test_rows_of_a_chunk_are_rows_of_the_field(tmp_path: Path, form: Any, degree: int) -> None:
    """Oracle: `schema.fetch` of a stage of the same layer, sliced."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=90, degree=degree), form=form)
    whole = field_of(path)
    same(read_chunk(str(path)), whole)
    for first, count in ((0, 90), (0, 1), (17, 30), (89, 1), (90, 0), (4, 0)):
        part = read_chunk(str(path), first, count)
        assert len(part) == count and part.sh_degree == degree
        same(part, rows_of(whole, slice(first, first + count)))
    same(read_chunk(str(path), 80), rows_of(whole, slice(80, None)))
    assert chunk_shape(str(path)) == (90, degree)


@pytest.mark.parametrize("suffix", ["usdc", "usda"])
def test_packed_rows_decode_to_the_same_splats(tmp_path: Path, suffix: str) -> None:
    """Oracle: `packing.unpack` of all rows, sliced."""
    path = tmp_path / f"chunk.{suffix}"
    write_chunk(path, cloud(n=50, degree=2))
    part = read_packed_chunk(str(path), 10, 20)
    assert part is not None and len(part.positions) == len(part.arrays.core) == 20
    assert len(part.arrays.harmonics) == 20 * packing.harmonics_width(2)
    ours = packing.unpack(part.positions, part.arrays)
    same(ours, rows_of(field_of(path), slice(10, 30)))


def test_a_float_chunk_has_no_packed_rows(tmp_path: Path) -> None:
    """Oracle: the form of the chunk."""
    write_chunk(tmp_path / "chunk.usdc", cloud(n=5), form="float")
    assert read_packed_chunk(str(tmp_path / "chunk.usdc")) is None


def test_rows_outlive_the_file(tmp_path: Path) -> None:
    """Oracle: the values before the file was replaced; views of mapped memory would change."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=50))
    part = read_chunk(str(path), 0, 50)
    before = part.positions.copy()
    path.unlink()
    path.write_bytes(b"")
    np.testing.assert_array_equal(part.positions, before)
    assert part.positions.base is None and part.positions.flags.writeable


def test_a_chunk_that_was_replaced_is_read_again(tmp_path: Path) -> None:
    """Oracle: the cloud that replaced it."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=50), form="float")
    read_chunk(str(path))
    write_chunk(tmp_path / "new.usdc", cloud(seed=2, n=60), form="float")
    (tmp_path / "new.usdc").rename(path)
    np.testing.assert_array_equal(read_chunk(str(path)).positions, cloud(seed=2, n=60).positions)


def test_an_edit_in_memory_is_read(tmp_path: Path) -> None:
    """Oracle: the value that was set on the open layer, which is not saved."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=3), form="float")
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.GetAttributeAtPath("/chunk.opacities").default = Vt.FloatArray([0.5, 0.25, 0.125])
    assert read_chunk(str(path), 1, 2).opacities.tolist() == [0.25, 0.125]


@pytest.mark.parametrize(("first", "count"), [(0, 51), (51, 0), (-1, 2), (5, -1), (2**62, 2**62)])
def test_rows_beyond_the_chunk_are_one_sentence(tmp_path: Path, first: int, count: int) -> None:
    """Oracle: the number of splats that were written."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=50))
    for read in (read_chunk, read_packed_chunk):
        with pytest.raises(StageError, match=f"found 50 splats, expected rows {first} to"):
            read(str(path), first, count)


def test_files_that_are_no_chunks_are_one_sentence(tmp_path: Path) -> None:
    """Oracle: a missing file, a file of noise, a layer without a default prim, one with another."""
    noise, empty, other = (tmp_path / f"{name}.usdc" for name in ("noise", "empty", "other"))
    noise.write_bytes(b"PXR-USDC" + bytes(range(200)))
    Usd.Stage.CreateNew(str(empty)).Save()
    stage = Usd.Stage.CreateNew(str(other))
    stage.SetDefaultPrim(stage.DefinePrim("/A", "Mesh"))
    stage.Save()
    for path, said in (
        ("", "chunk: found no file"),
        (str(tmp_path / "gone.usdc"), "nothing that USD can read|found"),
        (str(noise), "expected a layer with splats"),
        (str(empty), "found no default prim, expected a default prim of type Particle"),
        (str(other), "found a prim of type Mesh, expected a default prim"),
    ):
        with pytest.raises(StageError, match=said) as raised:
            read_chunk(path)
        assert "\n" not in str(raised.value)


def test_a_pipe_or_a_folder_is_one_sentence(tmp_path: Path) -> None:
    """Oracle: what is in the place of the file; reading a pipe would never end."""
    os.mkfifo(tmp_path / "pipe.usda")
    (tmp_path / "folder.usdc").mkdir()
    for name in ("pipe.usda", "folder.usdc"):
        with pytest.raises(StageError, match="found no regular file, expected a layer"):
            read_chunk(str(tmp_path / name))


def edited(path: Path, **values: Any) -> None:
    """Change default values of a chunk; None removes one."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    prim = layer.GetPrimAtPath("/chunk")
    for name, value in values.items():
        spec = prim.properties[name.replace("__", ":")]
        prim.RemoveProperty(spec)
        if value is not None:
            kind = Sdf.GetValueTypeNameForValue(value)
            Sdf.AttributeSpec(prim, name.replace("__", ":"), kind).default = value
    layer.Save()


@pytest.mark.parametrize(
    ("form", "values", "said"),
    [
        ("packed", {"splat__packed": Vt.Vec4iArray(49)}, "splat:packed: found no rows 49 to 50"),
        ("packed", {"splat__packed": None}, "splat:packed: found no rows 0 to 50"),
        (
            "packed",
            {"splat__packed": Vt.Vec4fArray(50)},
            "splat:packed: found a value of type Vec4f",
        ),
        ("packed", {"splat__packing": "other"}, "splat:packing: found 'other', expected 'smallest"),
        ("packed", {"splat__packedHarmonics": Vt.Vec4iArray(9)}, "splat:packedHarmonics: found no"),
        ("packed", {"splat__colorRange": Vt.Vec3fArray(1)}, "splat:colorRange: found no rows 1"),
        (
            "packed",
            {"splat__harmonicsRange": Vt.FloatArray([1, float("nan"), 1])},
            "splat:harmonicsRange: found a range that is not finite",
        ),
        ("packed", {"positions": "here"}, "positions: found a value of type str"),
        ("float", {"opacities": Vt.FloatArray(3)}, "opacities: found no rows 3 to 50"),
        ("float", {"scales": None}, "scales: found no rows 0 to 50"),
        ("float", {"orientations": Vt.Vec3fArray(50)}, "orientations: found a value of type Vec3f"),
        (
            "float",
            {"radiance__sphericalHarmonicsDegree": 7},
            "HarmonicsDegree: found 7, expected 0 to 4",
        ),
    ],
)
def test_a_wrong_array_is_one_sentence(
    tmp_path: Path, form: Any, values: dict[str, Any], said: str
) -> None:
    """Oracle: the array that was changed in a valid chunk."""
    path = tmp_path / "chunk.usdc"
    write_chunk(path, cloud(n=50), form=form)
    edited(path, **values)
    with pytest.raises(StageError) as raised:
        read_chunk(str(path))
    assert said in str(raised.value) and str(path) in str(raised.value)
