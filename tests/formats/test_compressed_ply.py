"""PlayCanvas's compressed PLY: files made from chosen words, decoded one number at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usdsplat import formats
from usdsplat.core.errors import FormatError

BOUNDS = [f"{side}_{axis}" for side in ("min", "max") for axis in "xyz"]
BOUNDS += [f"{side}_scale_{axis}" for side in ("min", "max") for axis in "xyz"]
COLOR_BOUNDS = [f"{side}_{channel}" for side in ("min", "max") for channel in "rgb"]
WORDS = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]


def make(
    count: int, *, colored: bool = True, rest: int = 0, seed: int = 3
) -> dict[str, np.ndarray]:
    """Random chunks, words and harmonics."""
    rng = np.random.default_rng(seed)
    names = BOUNDS + COLOR_BOUNDS * colored
    chunk = np.zeros(-(-count // 256), [(name, "f4") for name in names])
    for name in names:
        chunk[name] = rng.uniform(-3, -1, len(chunk)) + 2.5 * name.startswith("max")
    vertex = np.zeros(count, [(name, "u4") for name in WORDS])
    for name in WORDS:
        vertex[name] = rng.integers(0, 2**32, count)
    elements = {"chunk": chunk, "vertex": vertex}
    if rest:
        elements["sh"] = np.zeros(count, [(f"f_rest_{i}", "u1") for i in range(rest)])
        for name in elements["sh"].dtype.names:
            elements["sh"][name] = rng.integers(0, 256, count)
    return elements


def save(path, elements, *, text=False, order="<"):
    from plyfile import PlyData, PlyElement

    described = [PlyElement.describe(rows, name) for name, rows in elements.items()]
    PlyData(described, text=text, byte_order="=" if text else order).write(path)
    return path


def expected(elements, row):
    """Position, scale, rotation, opacity and harmonics of a splat, by formats.md section 2.2."""
    chunk = elements["chunk"][row // 256]
    place, turn, size, paint = (int(elements["vertex"][name][row]) for name in WORDS)

    def lerp(name, code, top):
        t = code / top
        has = f"min_{name}" in chunk.dtype.names
        low, high = (float(chunk[f"{side}_{name}"]) if has else None for side in ("min", "max"))
        return low * (1 - t) + high * t if has else t

    def split(word):
        return word >> 21, (word >> 11) & 1023, word & 2047

    tops = (2047, 1023, 2047)
    position = [lerp(a, c, top) for a, c, top in zip("xyz", split(place), tops, strict=True)]
    logs = [lerp(f"scale_{a}", c, top) for a, c, top in zip("xyz", split(size), tops, strict=True)]
    small = [((turn >> shift & 1023) / 1023 - 0.5) * math.sqrt(2) for shift in (20, 10, 0)]
    quaternion = list(small)
    quaternion.insert(turn >> 30, math.sqrt(max(0, 1 - sum(v * v for v in small))))
    length = math.sqrt(sum(v * v for v in quaternion))
    rgb = [lerp(c, paint >> shift & 255, 255) for c, shift in zip("rgb", (24, 16, 8), strict=True)]
    sh = [[(v - 0.5) / 0.28209479177387814 for v in rgb]]
    rest = len(elements["sh"].dtype.names) if "sh" in elements else 0
    for k in range(rest // 3):
        codes = [int(elements["sh"][f"f_rest_{c * rest // 3 + k}"][row]) for c in range(3)]
        unit = [0 if q == 0 else 1 if q == 255 else (q + 0.5) / 256 for q in codes]
        sh.append([(n - 0.5) * 8 for n in unit])
    scale = [math.exp(v) for v in logs]
    return position, scale, [v / length for v in quaternion], (paint & 255) / 255, sh


@pytest.mark.parametrize("rest", [0, 9, 24, 45, 72])
@pytest.mark.parametrize("colored", [True, False])
@pytest.mark.parametrize(("text", "order"), [(False, "<"), (False, ">"), (True, "=")])
def test_words_decode_as_the_layout_says(tmp_path, rest, colored, text, order):
    """Oracle: the layout of formats.md 2.2 in Python's own numbers, splat by splat."""
    elements = make(300, colored=colored, rest=rest)
    capture = formats.read(save(tmp_path / "a.compressed.ply", elements, text=text, order=order))
    cloud = capture.cloud
    for row in (0, 1, 255, 256, 299):
        position, scale, rotation, opacity, sh = expected(elements, row)
        np.testing.assert_allclose(cloud.positions[row], position, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(cloud.scales[row], scale, rtol=1e-6)
        np.testing.assert_allclose(cloud.rotations[row], rotation, atol=1e-6)
        np.testing.assert_allclose(cloud.opacities[row], opacity, atol=1e-7)
        np.testing.assert_allclose(cloud.sh[row], sh, atol=2e-6)
    assert capture.format == "compressed PLY"


def test_chunks_hold_across_blocks(tmp_path):
    """Oracle: as above, for rows beyond the first blocks of both elements."""
    elements = make(70_000, rest=9)
    cloud = formats.read(save(tmp_path / "a.ply", elements)).cloud
    for row in (16383, 16384, 29127, 65535, 69999):
        position, _, _, _, sh = expected(elements, row)
        np.testing.assert_allclose(cloud.positions[row], position, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(cloud.sh[row], sh, atol=2e-6)


def test_no_splats_are_a_cloud(tmp_path):
    """Oracle: no chunks and no words."""
    assert len(formats.read(save(tmp_path / "a.compressed.ply", make(0))).cloud) == 0


def test_opacity_bytes_reach_both_ends(tmp_path):
    """Oracle: 0 is opacity 0 and 255 is opacity 1, whose logits are infinite."""
    elements = make(2)
    elements["vertex"]["packed_color"] = (0xFFFFFF00, 0x000000FF)
    cloud = formats.read(save(tmp_path / "a.compressed.ply", elements)).cloud
    assert cloud.opacities.tolist() == [0, 1]


def test_a_renamed_file_is_known_by_its_elements(tmp_path):
    """Oracle: the same bytes under three names."""
    written = save(tmp_path / "a.compressed.ply", make(5)).read_bytes()
    for name in ("b.ply", "c", "d.spz"):
        (tmp_path / name).write_bytes(written)
        assert formats.read(tmp_path / name).format == "compressed PLY"


def drop(elements, element, *names):
    kept = [name for name in elements[element].dtype.names if name not in names]
    rows = np.zeros(
        len(elements[element]), [(name, elements[element].dtype[name]) for name in kept]
    )
    for name in kept:
        rows[name] = elements[element][name]
    elements[element] = rows


def spoil(elements, element, name, value):
    elements[element][name][-1] = value


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e: e.update(chunk=e["chunk"][:1]), "1 chunks for 300 splats, expected 2"),
        (lambda e: e.update(sh=e["sh"][:299]), "299 rows of element sh, expected 300"),
        (lambda e: e.pop("chunk"), "found no|no element chunk"),
        (lambda e: drop(e, "chunk", "max_scale_y"), "no property max_scale_y in element chunk"),
        (lambda e: drop(e, "chunk", "max_g"), "no property max_g in element chunk"),
        (lambda e: drop(e, "vertex", "packed_scale"), "no uint32 property packed_scale"),
        (lambda e: drop(e, "sh", "f_rest_3"), "8 f_rest_ properties without f_rest_3"),
        (lambda e: spoil(e, "chunk", "min_y", np.nan), "property min_y of chunk 1: found nan"),
        (lambda e: spoil(e, "chunk", "max_b", np.inf), "property max_b of chunk 1: found inf"),
        (lambda e: spoil(e, "chunk", "max_scale_z", 3e5), "scales of splat 2..: found inf"),
    ],
)
def test_elements_that_do_not_fit_are_refused(tmp_path, change, message):
    """Oracle: what was changed."""
    elements = make(300, rest=9)
    change(elements)
    with pytest.raises(FormatError, match=message):
        formats.read(save(tmp_path / "a.compressed.ply", elements))


def test_words_of_another_type_are_refused(tmp_path):
    """Oracle: a float has no bits to unpack."""
    elements = make(3)
    elements["vertex"] = elements["vertex"].astype([(name, "f4") for name in WORDS])
    with pytest.raises(FormatError, match="no uint32 property packed_position in element vertex"):
        formats.read(save(tmp_path / "a.compressed.ply", elements))
