"""Read chunks of a splat tree: layers whose default prim is a packed or a stock float field, and
SOG files.

Only the rows that are asked for are converted.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError, StageError
from usdsplat.core.wording import counted
from usdsplat.formats.sog import rows as sog
from usdsplat.schema.chunk_layers import PackedChunk, opened_layer
from usdsplat.schema.crate_arrays import layer_size


class ChunkReader:
    """Reader of the chunks of one tree, for several threads.

    It keeps some of the SOG files in memory that it has unpacked, because they are unpacked whole.

    Args:
        chunks: Resolved paths, from `Tree.chunks`.
        degree: Degree of the harmonics of the tree.
        digests: Digests that the chunks must state, from `Tree.digests`; "" for any.
    """

    def __init__(self, chunks: Sequence[str], degree: int, digests: Sequence[str] = ()) -> None:
        self.chunks = chunks
        """See above."""
        self.counts: dict[int, int] = {}
        """Number of splats of each chunk when it was first read."""
        self._degree, self._digests, self._sog = degree, digests, sog.SogRows()

    def read(self, chunk: int, first: int, count: int) -> SplatCloud:
        """Read rows of a chunk.

        Harmonics of a SOG of a lower degree are extended with zeros.

        Raises:
            StageError: If the chunk cannot be read, states another digest than the tree, or does
                not have these rows.
        """
        path = self.chunks[chunk]
        if path and sog.is_sog(path):
            with _sog_errors(path):
                found = self._sog.read(path, first, count, self._degree)
                if chunk not in self.counts:
                    self.counts[chunk] = self._sog.count(path)
                return found
        with opened_layer(path, self._digests[chunk] if self._digests else "") as field:
            self.counts.setdefault(chunk, field.count)
            return field.cloud(field.rows(first, count))


def read_chunk(path: str, first: int = 0, count: int | None = None) -> SplatCloud:
    """Read rows of a chunk that is a layer.

    Args:
        path: Resolved path of the chunk, from `Tree.chunks`; "" is a missing file.
        first: First row.
        count: Number of rows; None for all from `first`.

    Raises:
        StageError: If the layer cannot be read, has no field as its default prim, or does not have
            these rows.
    """
    with opened_layer(path) as field:
        return field.cloud(field.rows(first, count))


def read_packed_chunk(path: str, first: int = 0, count: int | None = None) -> PackedChunk | None:
    """Read rows of a chunk without decoding them; None if the chunk is not packed.

    Args and errors are those of `read_chunk`.
    """
    if path and sog.is_sog(path):
        return None
    with opened_layer(path) as field:
        return field.packed(field.rows(first, count)) if field.is_packed else None


def chunk_shape(path: str, digest: str = "") -> tuple[int, int]:
    """Return the number of splats of a chunk and the degree of its harmonics, without reading them.

    Args:
        path: As for `read_chunk`.
        digest: Digest that a layer must state, from `Tree.digests`; "" for any.

    Raises:
        StageError: If the chunk cannot be read, or is a layer without a field as its default prim
            or with another digest.
    """
    if path and sog.is_sog(path):
        with _sog_errors(path):
            return sog.count_and_degree(path)
    with opened_layer(path, digest) as field:
        return field.count, field.degree()


def chunk_digest(path: str) -> str:
    """Return the digest of the splats that a chunk has now, whatever it states; "" for a SOG.

    Raises:
        StageError: As for `read_chunk`.
    """
    if path and sog.is_sog(path):
        return ""
    with opened_layer(path) as field:
        return field.digest()


def check_chunk(path: str, rows: int, degree: int, whose: str, digest: str = "") -> None:
    """Raise an error unless a chunk has what the table of its tree states; no splat is read.

    Args:
        path: Resolved path of the chunk.
        rows: Number of rows that it must have at least.
        degree: Degree of the harmonics of the tree. A SOG may have a lower one.
        whose: Which part of the tree needs the last row, such as "for node 3".
        digest: As for `chunk_shape`.

    Raises:
        StageError: If the chunk cannot be read, is too short, or has another degree or digest.
    """
    held, found = chunk_shape(path, digest)
    if held < rows:
        raise StageError(path, counted(held, "splat"), f"at least {rows}, {whose}")
    if found > degree or (found < degree and not sog.is_sog(path)):
        raise StageError(path, f"harmonics of degree {found}", f"{degree}, as in the tree")


def chunk_stamp(path: str) -> tuple[int, int] | None:
    """Return two numbers that change when a chunk is written, for comparisons within one process;
    None if there is no such file."""
    try:
        if sog.is_sog(path):
            return sog.stamp(path)
        state = os.stat(path)
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size


def chunk_size(path: str) -> int:
    """Return the size of the files of a chunk [byte]; 0 if it cannot be read, or is in memory."""
    if not sog.is_sog(path):
        return layer_size(path)
    try:
        return sog.file_bytes(path)
    except (FormatError, OSError):
        return 0


@contextmanager
def _sog_errors(path: str) -> Iterator[None]:
    """Convert the errors of a SOG to those of other chunks.

    Raises:
        StageError: Instead of a FormatError or an OSError.
    """
    try:
        yield
    except FormatError as error:
        raise StageError(error.where, error.found, error.expected) from error
    except OSError as error:
        raise StageError(path, error.strerror or "an unreadable file", "a SOG file") from error
