"""Tests of PLY headers: all dialects, and headers with false counts."""

from __future__ import annotations

import numpy as np
import pytest

from tests.formats.samples import SPLAT_NAMES, SPLAT_ROW
from usdsplat import formats
from usdsplat.core.errors import FormatError
from usdsplat.formats.capture import UNKNOWN_AXES
from usdsplat.formats.ply.header import HEADER_LIMIT, parse_header
from usdsplat.formats.ply.table import open_table

PROPERTIES = [f"property float {name}" for name in SPLAT_NAMES]
BODY = np.array(SPLAT_ROW, "<f4").tobytes()


def header(*lines: str, end: str = "\n") -> bytes:
    return end.join(["ply", *lines, "end_header", ""]).encode()


def splat_header(*before: str, end: str = "\n", kind: str = "binary_little_endian") -> bytes:
    return header(f"format {kind} 1.0", *before, "element vertex 1", *PROPERTIES, end=end)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("first_byte", [b"\n", b"\r", b"\x00"])
def test_line_ends_do_not_eat_the_data(tmp_path, end, first_byte):
    """Oracle: the bytes of x, which begin with what a line end looks like."""
    x = np.frombuffer(first_byte + b"\x00\x80\x3f", "<f4")[0]
    body = np.array([x, *SPLAT_ROW[1:]], "<f4").tobytes()
    (tmp_path / "a.ply").write_bytes(splat_header(end=end) + body)
    assert formats.read(tmp_path / "a.ply").cloud.positions[0, 0] == x


def test_comments_information_and_blank_lines_change_nothing(tmp_path):
    """Oracle: the same data without them."""
    noise = ("comment Grüße: element vertex 9", "obj_info end_header", "", "comment")
    (tmp_path / "a.ply").write_bytes(splat_header(*noise) + BODY)
    assert formats.read(tmp_path / "a.ply").cloud.positions.tolist() == [[1, 2, 3]]
    parsed = parse_header("a", splat_header(*noise))
    assert parsed.comments == ("Grüße: element vertex 9", "")
    assert parsed.element("face") is None


def test_elements_ahead_of_the_vertices_are_skipped(tmp_path):
    """Oracle: their size in bytes, and in lines of text."""
    camera = ("element camera 2", "property double f", "property uchar n", "element none 3")
    binary = splat_header(*camera) + bytes(18) + BODY
    (tmp_path / "binary.ply").write_bytes(binary)
    row = " ".join(str(value) for value in SPLAT_ROW)
    text = splat_header(*camera, kind="ascii") + f"0 1\n\n2 3\n  {row}\n".encode()
    (tmp_path / "text.ply").write_bytes(text)
    for name in ("binary", "text"):
        assert formats.read(tmp_path / f"{name}.ply").cloud.positions.tolist() == [[1, 2, 3]]


def test_lists_ahead_of_the_vertices_are_skipped_in_text_and_refused_in_binary(tmp_path):
    """Oracle: a row of text is a line; the size of a binary row with a list is unknown."""
    faces = ("element face 1", "property list uchar int vertex_indices")
    row = " ".join(str(value) for value in SPLAT_ROW)
    (tmp_path / "text.ply").write_bytes(
        splat_header(*faces, kind="ascii") + f"3 0 1 2\n{row}".encode()
    )
    assert len(formats.read(tmp_path / "text.ply").cloud) == 1
    (tmp_path / "binary.ply").write_bytes(splat_header(*faces) + bytes(13) + BODY)
    with pytest.raises(FormatError, match="a list property in element face, expected rows"):
        formats.read(tmp_path / "binary.ply")


def test_lists_behind_the_vertices_are_nobodys_business(tmp_path):
    """Oracle: the vertices, and no remark about bytes that the faces may take."""
    lines = ("element vertex 1", *PROPERTIES, "element face 1", "property list uchar int v")
    data = header("format binary_little_endian 1.0", *lines) + BODY + bytes(13)
    (tmp_path / "a.ply").write_bytes(data)
    capture = formats.read(tmp_path / "a.ply")
    assert len(capture.cloud) == 1
    assert capture.notes == (UNKNOWN_AXES,)


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (["element vertex 1"], "0 format lines"),
        (["format ascii 1.0", "format ascii 1.0"], "2 format lines"),
        (["format binary_pdp_endian 1.0"], "header line 'format binary_pdp_endian 1.0'"),
        (["format ascii 1.0", "element vertex -1"], "'-1' as the count"),
        (["format ascii 1.0", "element vertex 1e3"], "'1e3' as the count"),
        (["format ascii 1.0", "element vertex " + "9" * 5000], "as the count"),
        (["format ascii 1.0", "element vertex 1", "element vertex 1"], "elements vertex, vertex"),
        (["format ascii 1.0", "property float x"], "header line 'property float x'"),
        (["format ascii 1.0", "element vertex 1", "property float"], "header line"),
        (["format ascii 1.0", "element vertex 1", "property quad x"], "property type 'quad'"),
        (["format ascii 1.0", "element v 1", "property list float int v w"], "header line"),
        (["format ascii 1.0", "element v 1", "property list list int v"], "property type 'list'"),
        (["format ascii 1.0", "element v 1", "property list v"], "property type 'list'"),
        (
            ["format ascii 1.0", "element v 1", "property int x", "property float x"],
            "property x twice",
        ),
        (["nonsense"], "header line 'nonsense'"),
    ],
)
def test_a_header_line_that_cannot_be_is_quoted(lines, found):
    """Oracle: the line that is wrong."""
    with pytest.raises(FormatError) as caught:
        parse_header("a.ply", header(*lines))
    assert found in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "head", [b"", b"plx\n", b"ply", b"ply\nformat ascii 1.0\n", b"plyformat\n"]
)
def test_what_is_no_header_is_refused(head):
    """Oracle: the first line is `ply` and the last `end_header`."""
    with pytest.raises(FormatError, match=r"at the start|no end_header"):
        parse_header("a.ply", head)


def test_a_header_that_does_not_end_is_given_up_early(tmp_path):
    """Oracle: the limit; the rest of the file is not read."""
    path = tmp_path / "endless.ply"
    path.write_bytes(b"ply\nformat ascii 1.0\n" + b"comment more\n" * 100_000)
    with pytest.raises(FormatError, match=f"no end_header in the first {HEADER_LIMIT} bytes"):
        formats.read(path)


@pytest.mark.parametrize("kind", ["binary_little_endian", "binary_big_endian", "ascii"])
@pytest.mark.parametrize("count", [2, 4_000_000_000, 10**18 - 1])
def test_a_count_beyond_the_file_is_refused_before_reading(tmp_path, kind, count):
    """Oracle: the size of the file."""
    lines = (f"format {kind} 1.0", f"element vertex {count}", *PROPERTIES)
    (tmp_path / "lies.ply").write_bytes(header(*lines) + b" ".join([b"1"] * 14))
    with pytest.raises(FormatError, match=f"expected at least .* for {count} rows"):
        formats.read(tmp_path / "lies.ply")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3 4\n5 6 x 8\n", "text that is not a number"),
        ("1 2 3 4\n5 6 7\n8\n", "text that is not a number, or rows of different lengths"),
        ("1 2 3\n5 6 7  \n\n\n", "found 3 numbers a row, expected 4"),
        ("1 2 3 4          \n", "found 1 rows of element vertex, expected 2"),
        ("1 2 3 4\n" + "5" * 70_000, "a line of 65536 bytes"),
    ],
)
def test_text_rows_are_counted_and_measured(tmp_path, text, message):
    """Oracle: two rows of four numbers."""
    names = [f"property float {name}" for name in ("x", "y", "z", "w")]
    data = header("format ascii 1.0", "element vertex 2", *names) + text.encode()
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(FormatError, match=message):
        formats.read(tmp_path / "a.ply")


def test_a_file_cut_while_it_is_read_is_refused(tmp_path):
    """Oracle: rows that were there when the header was read are gone."""
    path = tmp_path / "a.ply"
    lines = ("format binary_little_endian 1.0", "element vertex 8", "property double x")
    path.write_bytes(header(*lines) + bytes(64))
    table = open_table(path, parse_header("a.ply", path.read_bytes()), "vertex")
    path.write_bytes(path.read_bytes()[:-16])
    with pytest.raises(FormatError, match="found 4 rows of element vertex, expected 8"):
        list(table.blocks(4))
    table.rows_per_block = 4
    with pytest.raises(FormatError, match="found 4 rows of element vertex, expected 8"):
        table.visit(lambda rows, block: None, lambda done: None)


def test_a_file_without_vertices_is_refused(tmp_path):
    """Oracle: the element that is missing, or made of lists."""
    (tmp_path / "a.ply").write_bytes(header("format ascii 1.0", "element face 0"))
    with pytest.raises(FormatError, match="no element vertex"):
        formats.read(tmp_path / "a.ply")
    lists = ("element vertex 1", "property list uchar float x")
    (tmp_path / "b.ply").write_bytes(header("format ascii 1.0", *lists) + b"1 1\n")
    with pytest.raises(FormatError, match="a list property in element vertex"):
        formats.read(tmp_path / "b.ply")
