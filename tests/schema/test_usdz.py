"""Tests of .usdz packages."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from usdsplat.core.errors import OutputError
from usdsplat.schema import usdz


def packed(*members: tuple[str, bytes]) -> bytes:
    """A package."""
    file = io.BytesIO()
    usdz.write(file, [(name, io.BytesIO(data)) for name, data in members], where="a.usdz")
    return file.getvalue()


@pytest.mark.parametrize("length", range(1, 70))
def test_members_are_stored_and_aligned(length: int) -> None:
    """Oracle: Python's zipfile, and the position of the bytes; names of any length."""
    members = [("n" * length + ".usdc", b"abcd" * 9), ("0/tëxture.png", b"xyz")]
    data = packed(*members)
    archive = zipfile.ZipFile(io.BytesIO(data))
    assert archive.testzip() is None
    assert [(item.filename, archive.read(item)) for item in archive.infolist()] == members
    assert {item.compress_type for item in archive.infolist()} == {zipfile.ZIP_STORED}
    assert all(data.index(content) % 64 == 0 for _, content in members)


@pytest.mark.parametrize(
    ("epoch", "expected"),
    [
        (None, (1980, 1, 1, 0, 0, 0)),
        ("1700000000", (2023, 11, 14, 22, 13, 20)),
        ("0", (1980, 1, 1, 0, 0, 0)),
        ("99999999999", (2107, 12, 31, 23, 59, 58)),
        ("soon", (1980, 1, 1, 0, 0, 0)),
    ],
)
def test_the_date_is_that_of_the_environment(
    monkeypatch: pytest.MonkeyPatch, epoch: str | None, expected: tuple[int, ...]
) -> None:
    """Oracle: `date -u -d @1700000000`; before 1980 and after 2107 zip files have no dates."""
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    if epoch is not None:
        monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    (item,) = zipfile.ZipFile(io.BytesIO(packed(("a.usdc", b"")))).infolist()
    assert item.date_time == expected


def test_a_package_is_too_large_for_its_format(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the limit, lowered here from 4 GiB."""
    monkeypatch.setattr(usdz, "_LARGEST", 100)
    with pytest.raises(OutputError, match=r"a\.usdz: found a package of more than 4 GiB"):
        packed(("a.usdc", bytes(60)))


def test_a_package_has_too_many_members_for_its_format(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the limit, lowered here from 65,535; as many members as that are packed."""
    monkeypatch.setattr(usdz, "_MOST", 2)
    members = [("a.usdc", b""), ("b.usdc", b"")]
    assert len(zipfile.ZipFile(io.BytesIO(packed(*members))).namelist()) == 2
    with pytest.raises(OutputError, match=r"a\.usdz: found more than 2 files to pack"):
        packed(*members, ("c.usdc", b""))


def test_the_end_record(tmp_path: Path) -> None:
    """Oracle: the last record of a zip file of Python's."""
    other = tmp_path / "other.zip"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("a", b"")
    for data in (other.read_bytes(), packed(("a.usdc", b""))):
        assert data[-usdz.END_SIZE :].startswith(usdz.END)
