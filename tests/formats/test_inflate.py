"""Tests of decompression up to a limit."""

from __future__ import annotations

import gzip
import io
import tracemalloc

import pytest

from tests.formats.hostile import zeros_in_gzip
from usdsplat.core.errors import FormatError
from usdsplat.formats.inflate import BYTES_PER_SPLAT, TRUSTED_COUNT, Gunzip, Unzstd, check_count


def zstd(data: bytes) -> bytes:
    import zstandard

    return zstandard.ZstdCompressor().compress(data)


DATA = bytes(range(256)) * 5000
OPENED = [
    lambda: Gunzip("a", io.BytesIO(gzip.compress(DATA))),
    lambda: Unzstd("a", zstd(DATA)),
]


@pytest.mark.parametrize("opened", OPENED)
def test_pieces_of_any_size_are_the_data(opened):
    """Oracle: what gzip and zstandard packed."""
    stream = opened()
    pieces = [
        bytes(stream.read(size, "data")) for size in (0, 1, 999, 300_000, 1_279_000 - 300_000)
    ]
    assert b"".join(pieces) == DATA
    stream.expect_end("the data")
    assert stream.read_up_to(10) == b""


@pytest.mark.parametrize("opened", OPENED)
def test_too_little_and_too_much_are_refused(opened):
    """Oracle: the length of the data."""
    with pytest.raises(FormatError, match=f"found {len(DATA)} bytes of data, expected 2000000"):
        opened().read(2_000_000, "data")
    stream = opened()
    stream.read(len(DATA) - 1, "data")
    with pytest.raises(FormatError, match="more data after the header"):
        stream.expect_end("the header")


def test_memory_follows_what_arrives_not_what_is_asked():
    """Oracle: 10 000 GB were asked for, a megabyte is there."""
    packed = gzip.compress(bytes(1 << 20))
    tracemalloc.start()
    try:
        with pytest.raises(FormatError):
            Gunzip("a", io.BytesIO(packed)).read(10**13, "data")
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 8 << 20


def test_a_bomb_is_left_alone_behind_what_was_asked():
    """Oracle: 64 MB lie behind the header; a window of zlib's own is all that is made of them."""
    packed = zeros_in_gzip(b"head", 1 << 26)
    tracemalloc.start()
    try:
        stream = Gunzip("a", io.BytesIO(packed))
        assert stream.read(4, "header") == b"head"
        with pytest.raises(FormatError, match="more data"):
            stream.expect_end("the header")
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1 << 20


@pytest.mark.parametrize(
    ("count", "file_bytes", "is_fine"),
    [
        (TRUSTED_COUNT, 1, True),
        (TRUSTED_COUNT + 1, 1, False),
        (10**8, BYTES_PER_SPLAT * 10**8, True),
        (10**8, BYTES_PER_SPLAT * 10**8 - 1, False),
    ],
)
def test_counts_are_believed_as_far_as_the_file_is_long(count, file_bytes, is_fine):
    """Oracle: the two limits, at their edges."""
    if is_fine:
        check_count("a", count, file_bytes)
    else:
        with pytest.raises(FormatError, match=f"{count} splats in {file_bytes} bytes"):
            check_count("a", count, file_bytes)
