"""Tests of the check that an EXR file is complete.

Oracle of all: files of OpenImageIO and OpenEXR are whole, and the same bytes without their end are
not.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from usdsplat.images.compression import FLAT_COMPRESSIONS
from usdsplat.images.exr import ExrWriter
from usdsplat.images.layout import ImageLayout
from usdsplat.images.whole_exr import is_whole_exr

SIZE = 133, 77


def cut(path: Path, missing: int) -> Path:
    """A copy of a file without its last bytes."""
    shorter = path.with_name(f"cut{missing}.exr")
    shorter.write_bytes(path.read_bytes()[:-missing])
    return shorter


def check(path: Path) -> None:
    """The file is whole; without one byte, or more, it is not, nor with a hole in its table."""
    size = path.stat().st_size
    assert is_whole_exr(path)
    found = [cut(path, missing) for missing in (1, 2, 17, 500, size // 2, size - 20, size - 4)]
    assert [is_whole_exr(each) for each in found] == [False] * len(found)


def noise(channels: int = 4, **attributes: object) -> oiio.ImageBuf:
    """A picture that does not compress well."""
    spec = oiio.ImageSpec(*SIZE, channels, "half")
    for name, value in attributes.items():
        spec.attribute(name, value)
    picture = oiio.ImageBuf(spec)
    oiio.ImageBufAlgo.noise(picture, "gaussian", 0.5, 0.2)
    return picture


@pytest.mark.parametrize(
    "compression", ["none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab"]
)
def test_scan_lines_of_every_compression(tmp_path: Path, compression: str) -> None:
    """Oracle: as above; the number of chunks depends on the compression."""
    path = tmp_path / "a.exr"
    assert noise(compression=compression).write(str(path))
    check(path)


def test_tiles(tmp_path: Path) -> None:
    """Oracle: as above; the spec that OpenImageIO reads back has tiles."""
    path = tmp_path / "a.exr"
    picture = noise()
    picture.set_write_tiles(32, 16)
    assert picture.write(str(path))
    assert oiio.ImageBuf(str(path)).spec().tile_width == 32
    check(path)


@pytest.mark.parametrize("size", [(133, 77), (64, 64), (300, 9)])
def test_mipmaps(tmp_path: Path, size: tuple[int, int]) -> None:
    """Oracle: as above, for textures with all levels down to one pixel."""
    path, config = tmp_path / "a.exr", oiio.ImageSpec()
    config.tile_width = config.tile_height = 16
    picture = oiio.ImageBuf(oiio.ImageSpec(*size, 3, "half"))
    oiio.ImageBufAlgo.noise(picture, "gaussian", 0.5, 0.2)
    assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, picture, str(path), config)
    check(path)


@pytest.mark.parametrize("compression", FLAT_COMPRESSIONS)
def test_several_parts(tmp_path: Path, compression: str) -> None:
    """Oracle: as above, for our own writer with a part for each AOV."""
    path = tmp_path / "a.exr"
    layout = ImageLayout(
        resolution=SIZE, aovs=("color", "Z", "id"), multipart=True, compression=compression
    )
    rng = np.random.default_rng(3)
    with ExrWriter(path, layout) as writer:
        rows = {
            "color": rng.random((SIZE[1], SIZE[0], 4), np.float32),
            "Z": rng.random((SIZE[1], SIZE[0]), np.float32),
            "id": rng.integers(0, 9, (SIZE[1], SIZE[0]), np.uint32),
        }
        writer.write_band(0, rows)
    assert oiio.ImageBuf(str(path)).nsubimages == 3
    check(path)


def test_a_chunk_without_data(tmp_path: Path) -> None:
    """Oracle: zeros where a chunk was, as a write that was lost in the middle leaves them."""
    path = tmp_path / "a.exr"
    assert noise(compression="zip").write(str(path))
    data = bytearray(path.read_bytes())
    start = data.index(struct.pack("<ii", 16, 0)[:4], 600)  # row 16 begins the second chunk
    data[start : start + 200] = bytes(200)
    assert is_whole_exr(path)
    path.write_bytes(data)
    assert not is_whole_exr(path)


@pytest.mark.parametrize("data", [b"", b"PNG", struct.pack("<iI", 20000630, 2)])
def test_other_files(tmp_path: Path, data: bytes) -> None:
    """Oracle: the bytes."""
    path = tmp_path / "a.exr"
    path.write_bytes(data)
    assert not is_whole_exr(path)
