"""Tests of the .ply reader and writer. Oracles: plyfile, and closed forms."""

from __future__ import annotations

import os
import re
import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.formats.compare import differences
from tests.formats.samples import SPLAT_NAMES, SPLAT_ROW, ply, random_cloud
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError, OutputError
from usdsplat.formats import ply as ply_format
from usdsplat.formats.capture import UNKNOWN_AXES

FEW = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def columns(degree: int) -> list[str]:
    """INRIA's properties in INRIA's order."""
    rest = [f"f_rest_{i}" for i in range(3 * ((degree + 1) ** 2 - 1))]
    tail = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    return ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, *tail]


def decoded(values: dict[str, np.ndarray], degree: int) -> SplatCloud:
    """What 3DGS's columns mean, in float64 and one property at a time."""
    per_channel = (degree + 1) ** 2 - 1
    count = len(values["x"])
    sh = np.zeros((count, per_channel + 1, 3))
    for channel in range(3):
        sh[:, 0, channel] = values[f"f_dc_{channel}"]
        for k in range(per_channel):
            sh[:, k + 1, channel] = values[f"f_rest_{channel * per_channel + k}"]
    turns = np.stack([values[f"rot_{i}"] for i in range(4)], axis=1).astype(np.float64)
    fields = {
        "positions": np.stack([values[axis] for axis in "xyz"], axis=1),
        "scales": np.exp(np.stack([values[f"scale_{i}"] for i in range(3)], axis=1)),
        "rotations": turns / np.linalg.norm(turns, axis=1, keepdims=True),
        "opacities": 1 / (1 + np.exp(-values["opacity"].astype(np.float64))),
        "sh": sh,
    }
    return SplatCloud(**{name: array.astype(np.float32) for name, array in fields.items()})


def assert_same(ours: SplatCloud, expected: SplatCloud, tolerance: float = 1e-6) -> None:
    for name in ("positions", "scales", "rotations", "opacities", "sh"):
        a, b = getattr(ours, name), getattr(expected, name)
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance, err_msg=name)


@FEW
@given(
    count=st.integers(0, 5),
    degree=st.integers(0, 4),
    order=st.sampled_from("<>"),
    text=st.booleans(),
    kinds=st.lists(st.sampled_from(["f4", "f8"]), min_size=1, max_size=3),
    ahead=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_order_type_and_encoding_of_the_columns_reads_the_same(
    tmp_path, count, degree, order, text, kinds, ahead, seed
):
    """Oracle: plyfile writes the file; the meaning is computed property by property in float64."""
    from plyfile import PlyData, PlyElement

    rng = np.random.default_rng(seed)
    names = [*columns(degree), "extra", "red"]
    rng.shuffle(names)
    fields = [(name, kinds[i % len(kinds)]) for i, name in enumerate(names)]
    fields[names.index("extra")] = ("extra", "i2")
    fields[names.index("red")] = ("red", "u1")
    rows = np.zeros(count, fields)
    for name in names:
        rows[name] = rng.normal(0, 1.5, count).round(3) if name not in ("extra", "red") else 7
    elements = [PlyElement.describe(rows, "vertex")]
    if ahead:
        camera = np.array([(1.5, 3), (2.5, 4)], [("focal", "f4"), ("index", "u2")])
        elements.insert(0, PlyElement.describe(camera, "camera"))
    path = tmp_path / "any.ply"
    PlyData(elements, text=text, byte_order="=" if text else order).write(path)

    capture = formats.read(path)
    assert_same(capture.cloud, decoded({name: rows[name] for name in names}, degree))
    assert capture.notes == (UNKNOWN_AXES,)
    assert capture.frame == "rdf"
    assert ("ascii" in capture.format) == text


@FEW
@given(count=st.integers(0, 5), degree=st.integers(0, 4), seed=st.integers(0, 2**32 - 1))
def test_a_written_file_means_the_cloud(tmp_path, count, degree, seed):
    """Oracle: plyfile reads what we write; the meaning is computed in float64."""
    from plyfile import PlyData

    cloud = random_cloud(count, degree, seed)
    formats.write(cloud, tmp_path / "out.ply")
    vertex = PlyData.read(tmp_path / "out.ply", mmap=False)["vertex"]
    names = [prop.name for prop in vertex.properties]
    assert names == columns(degree)
    assert {prop.val_dtype for prop in vertex.properties} == {"f4"}
    assert_same(decoded({name: vertex[name] for name in names}, degree), cloud, 2e-6)
    assert not np.any([vertex[name] for name in ("nx", "ny", "nz")])


@FEW
@given(count=st.integers(0, 5), degree=st.integers(0, 4), seed=st.integers(0, 2**32 - 1))
def test_writing_and_reading_returns_the_cloud(tmp_path, count, degree, seed):
    """Round trip: exp(log) and sigmoid(logit) in float32 lose a few units in the last place."""
    cloud = random_cloud(count, degree, seed)
    formats.write(cloud, tmp_path / "out.ply")
    assert_same(formats.read(tmp_path / "out.ply").cloud, cloud, 2e-6)


def test_blocks_join_without_a_seam(tmp_path):
    """Round trip over several blocks: every row is unlike its neighbours."""
    cloud = random_cloud(20_000, 1)
    seen = []

    class Listener:
        def step(self, label: str, done: int, total: int) -> None:
            seen.append((label.split()[0], done, total))

    formats.write(cloud, tmp_path / "out.ply", progress=Listener())
    back = formats.read(tmp_path / "out.ply", progress=Listener())
    apart = differences(back.cloud, cloud)
    assert max(apart.position, apart.dc, apart.harmonics) == 0
    assert max(apart.log_scale, apart.opacity) < 2e-6
    for verb in ("writing", "reading"):
        steps = [done for said, done, total in seen if said == verb and total == 20_000]
        assert len(steps) > 1 and steps == sorted(steps) and steps[-1] == 20_000


def test_ends_of_the_range_survive(tmp_path):
    """Oracle: sigmoid(+-inf) = 1 and 0, exp(-inf) = 0; formats.md 2.1 calls these legal."""
    cloud = random_cloud(2, 0)
    cloud.opacities[:] = (0, 1)
    cloud.scales[0] = 0
    formats.write(cloud, tmp_path / "out.ply")
    back = formats.read(tmp_path / "out.ply").cloud
    assert back.opacities.tolist() == [0, 1]
    assert back.scales[0].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("comment", "expected"),
    [
        ("SplatRenderMode: mip", True),
        ("SplatRenderMode: default", False),
        ("antialiased 1", True),
        ("antialiased 0", False),
        ("postshot.anti_aliasing=1", True),
        ("trained on antialiased 1 photographs", False),
    ],
)
def test_comments_tell_the_projection(tmp_path, comment, expected):
    """Oracle: the comments that Brush and Postshot write (formats.md 2.1)."""
    body = ply(np.array([SPLAT_ROW])).replace(b"element", f"comment {comment}\nelement".encode(), 1)
    (tmp_path / "a.ply").write_bytes(body)
    assert formats.read(tmp_path / "a.ply").antialiased is expected


@pytest.mark.parametrize("antialiased", [False, True])
def test_the_projection_is_written_and_read(tmp_path, antialiased):
    """Round trip of the flag."""
    formats.write(
        random_cloud(1, 0), tmp_path / "a.ply", how=formats.WriteOptions(antialiased=antialiased)
    )
    assert formats.read(tmp_path / "a.ply").antialiased is antialiased


def test_without_scale_2_splats_are_flat(tmp_path):
    """Oracle: 2DGS has no third axis, so its length is 0."""
    names = tuple(name for name in SPLAT_NAMES if name != "scale_2")
    row = [value for name, value in zip(SPLAT_NAMES, SPLAT_ROW, strict=True) if name != "scale_2"]
    (tmp_path / "flat.ply").write_bytes(ply(np.array([row, row]), names=names))
    capture = formats.read(tmp_path / "flat.ply")
    np.testing.assert_allclose(capture.cloud.scales, [[np.exp(-1), np.exp(-2), 0]] * 2, rtol=1e-6)
    assert "flat" in " ".join(capture.notes)


def test_half_and_integer_columns_are_numbers(tmp_path):
    """Oracle: struct's own half floats and small integers."""
    kinds = {"x": ("half", "e"), "y": ("short", "h"), "z": ("uchar", "B")}
    lines = ["ply", "format binary_big_endian 1.0", "element vertex 1"]
    lines += [f"property {kinds.get(name, ('double', 'd'))[0]} {name}" for name in SPLAT_NAMES]
    code = ">" + "".join(kinds.get(name, ("double", "d"))[1] for name in SPLAT_NAMES)
    body = struct.pack(code, -1.5, -300, 200, *SPLAT_ROW[3:])
    (tmp_path / "odd.ply").write_bytes("\n".join([*lines, "end_header\n"]).encode() + body)
    cloud = formats.read(tmp_path / "odd.ply").cloud
    assert cloud.positions.tolist() == [[-1.5, -300, 200]]
    assert cloud.opacities.tolist() == [0.5]


def test_rotations_of_any_length_become_unit_and_zero_ones_are_dropped(tmp_path):
    """Oracle: q / |q|, which float32 squares could not form; formats.md 2.1 drops zero norms."""
    turns = np.array([[3e25, 0, 4e25, 0], [0, 0, 0, 0], [0, 0, 3e-30, -4e-30], [1, 1, 1, 1]])
    rows = np.array([[*SPLAT_ROW[:10], *turn] for turn in turns])
    rows[:, 0] = range(4)
    (tmp_path / "turns.ply").write_bytes(ply(rows))
    capture = formats.read(tmp_path / "turns.ply")
    expected = [[0.6, 0, 0.8, 0], [0, 0, 0.6, -0.8], [0.5, 0.5, 0.5, 0.5]]
    np.testing.assert_allclose(capture.cloud.rotations, expected, atol=1e-6)
    assert capture.cloud.positions[:, 0].tolist() == [0, 2, 3]
    assert capture.notes == (
        UNKNOWN_AXES,
        "splats dropped because their rotation is zero: 1",
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("y", np.nan),
        ("z", np.inf),
        ("f_dc_2", -np.inf),
        ("f_rest_7", np.nan),
        ("opacity", np.nan),
        ("scale_1", np.inf),
        ("scale_2", 200.0),  # exp leaves float32
        ("rot_3", np.nan),
    ],
)
def test_what_is_not_finite_is_named_with_its_first_row(tmp_path, name, value):
    """Oracle: the property and row that were spoilt."""
    names = tuple(columns(1))
    rows = np.zeros((9000, len(names)))
    rows[:, names.index("rot_0")] = 1
    rows[[6789, 8000], names.index(name)] = value
    (tmp_path / "bad.ply").write_bytes(ply(rows, names=names))
    with pytest.raises(FormatError, match=f"property {name} of splat 6789: found"):
        formats.read(tmp_path / "bad.ply")


def test_bytes_behind_the_last_element_are_ignored_and_noted(tmp_path):
    """Oracle: the number of bytes appended."""
    (tmp_path / "long.ply").write_bytes(ply(np.array([SPLAT_ROW])) + bytes(77))
    capture = formats.read(tmp_path / "long.ply")
    assert len(capture.cloud) == 1
    assert capture.notes == (
        UNKNOWN_AXES,
        "ignored 77 bytes after the last element",
    )


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        (("opacity",), "no property opacity"),
        (("rot_2",), "no property rot_2"),
        (("x",), "no property x"),
        (("scale_0", "scale_1"), "no property scale_0"),
    ],
)
def test_a_splat_file_lacks_nothing(tmp_path, missing, message):
    """Oracle: the property that was left out; half a splat is not a plain point."""
    names = tuple(name for name in SPLAT_NAMES if name not in missing)
    (tmp_path / "a.ply").write_bytes(ply(np.ones((1, len(names))), names=names))
    with pytest.raises(FormatError, match=message):
        formats.read(tmp_path / "a.ply")


@pytest.mark.parametrize("rest", [["f_rest_0"], [f"f_rest_{i}" for i in range(1, 10)]])
def test_harmonics_are_those_of_a_degree(tmp_path, rest):
    """Oracle: 3 (degree + 1)^2 - 3 for degrees 0 to 4."""
    names = (*SPLAT_NAMES, *rest)
    (tmp_path / "a.ply").write_bytes(ply(np.ones((1, len(names))), names=names))
    with pytest.raises(
        FormatError, match=r"found . f_rest_ properties.*expected 0, 9, 24, 45 or 72"
    ):
        formats.read(tmp_path / "a.ply")


def test_reading_takes_the_memory_of_the_cloud(tmp_path):
    """Oracle: 236 bytes a splat at degree 3, and a few blocks for each thread."""
    count, some_blocks = 100_000, 3_000_000 * min(8, os.cpu_count() or 1)
    formats.write(random_cloud(count, 3), tmp_path / "big.ply")
    tracemalloc.start()
    try:
        cloud = formats.read(tmp_path / "big.ply").cloud
        _, most_read = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        before, _ = tracemalloc.get_traced_memory()
        formats.write(cloud, tmp_path / "copy.ply")
        _, most_written = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most_read < count * 237 + some_blocks
    assert most_written - before < some_blocks


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    """Oracle: the bytes that stood there."""
    path = tmp_path / "kept.ply"
    path.write_bytes(b"old")

    class Stop:
        def step(self, label: str, done: int, total: int) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        formats.write(random_cloud(3, 0), path, progress=Stop())
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["kept.ply"]
    with pytest.raises(OutputError, match=re.escape(str(tmp_path / "none"))):
        formats.write(random_cloud(3, 0), tmp_path / "none" / "a.ply")


def test_a_part_of_a_binary_file_is_read(tmp_path):
    """Oracle: the same rows of the whole file; text and plain points are not read in parts."""
    ply_format.write(random_cloud(40, 1), tmp_path / "a.ply")
    whole = ply_format.read(tmp_path / "a.ply").cloud
    assert ply_format.count_splats(tmp_path / "a.ply") == 40
    for first, last in ((0, 0), (0, 40), (7, 23), (39, 40)):
        part = ply_format.read_part(tmp_path / "a.ply", first, last)
        assert part.notes == ply_format.read(tmp_path / "a.ply").notes
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            expected = getattr(whole, name)[first:last]
            np.testing.assert_array_equal(getattr(part.cloud, name), expected)
    text = "ply\nformat ascii 1.0\nelement vertex 1\n"
    names = "".join(f"property float {name}\n" for name in SPLAT_NAMES)
    row = " ".join(map(str, SPLAT_ROW))
    (tmp_path / "t.ply").write_text(f"{text}{names}end_header\n{row}\n")
    assert ply_format.read(tmp_path / "t.ply").cloud.positions.shape == (1, 3)
    assert ply_format.count_splats(tmp_path / "t.ply") is None
