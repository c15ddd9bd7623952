"""Reader of uncompressed scanline EXR files, from the description of the file layout: an oracle."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

TYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


class ExrFile:
    """`parts` of (attributes: name -> (type, bytes), channels: name -> array)."""

    def __init__(self, path: Path) -> None:
        self.data = path.read_bytes()
        magic, version = struct.unpack_from("<iI", self.data)
        assert magic == 20000630
        self.multipart = bool(version & 0x1000)
        self.at = 8
        headers = [self.header()]
        while self.multipart and self.data[self.at]:
            headers.append(self.header())
        self.at += self.multipart
        self.parts = [(header, {}) for header in headers]
        if headers[0]["compression"][1] == b"\0":
            self.pixels()

    def text(self) -> str:
        end = self.data.index(b"\0", self.at)
        word = self.data[self.at : end].decode()
        self.at = end + 1
        return word

    def header(self) -> dict[str, tuple[str, bytes]]:
        found = {}
        while self.data[self.at]:
            name, kind = self.text(), self.text()
            (size,) = struct.unpack_from("<i", self.data, self.at)
            found[name] = kind, self.data[self.at + 4 : self.at + 4 + size]
            self.at += 4 + size
        self.at += 1
        return found

    def channels(self, part: int) -> list[tuple[str, np.dtype]]:
        raw, at, found = self.parts[part][0]["channels"][1], 0, []
        while raw[at]:
            end = raw.index(b"\0", at)
            found.append((raw[at:end].decode(), TYPES[struct.unpack_from("<i", raw, end + 1)[0]]))
            at = end + 17
        return found

    def window(self, part: int, name: str = "dataWindow") -> tuple[int, int, int, int]:
        """(x0, y0, x1, y1), end exclusive."""
        x0, y0, x1, y1 = struct.unpack("<4i", self.parts[part][0][name][1])
        return x0, y0, x1 + 1, y1 + 1

    def pixels(self) -> None:
        windows = [self.window(i) for i in range(len(self.parts))]
        for i, (x0, y0, x1, y1) in enumerate(windows):
            for name, dtype in self.channels(i):
                self.parts[i][1][name] = np.zeros((y1 - y0, x1 - x0), dtype)
        for i, (_, y0, _, y1) in enumerate(windows):
            offsets = struct.unpack_from(f"<{y1 - y0}Q", self.data, self.at)
            self.at += 8 * (y1 - y0)
            for offset in offsets:
                self.chunk(offset, i)

    def chunk(self, at: int, expected_part: int) -> None:
        part = 0
        if self.multipart:
            (part,) = struct.unpack_from("<i", self.data, at)
            at += 4
        assert part == expected_part
        y, _ = struct.unpack_from("<ii", self.data, at)
        at += 8
        for name, dtype in self.channels(part):
            row = self.parts[part][1][name][y - self.window(part)[1]]
            row[:] = np.frombuffer(self.data, dtype, len(row), at)
            at += row.nbytes
