"""Tests of the .splat layout: records made by hand, and round trips."""

from __future__ import annotations

import dataclasses
import struct

import numpy as np
import pytest

from tests.formats.compare import differences
from tests.formats.samples import random_cloud
from usdsplat import formats
from usdsplat.core.errors import FormatError, OutputError
from usdsplat.formats.options import ReadOptions

C0 = 0.28209479177387814


def record(place=(1, 2, 3), size=(0.5, 0.25, 2), rgba=(255, 0, 51, 204), turn=(128, 192, 128, 128)):
    """32 bytes of one splat; the turn is a half one about x, of length 1/2."""
    return struct.pack("<6f8B", *place, *size, *rgba, *turn)


def test_a_record_decodes_as_the_layout_says(tmp_path):
    """Oracle: formats.md 2.3 in Python's own numbers."""
    path = tmp_path / "a.SPLAT"
    path.write_bytes(record() + record(turn=(0, 128, 128, 255), rgba=(0, 0, 0, 0)))
    capture = formats.read(path)
    cloud = capture.cloud
    np.testing.assert_array_equal(cloud.positions, [[1, 2, 3]] * 2)
    np.testing.assert_array_equal(cloud.scales, [[0.5, 0.25, 2]] * 2)
    np.testing.assert_allclose(cloud.opacities, [0.8, 0])
    np.testing.assert_allclose(cloud.sh[0, 0], (np.array([1, 0, 0.2]) - 0.5) / C0, rtol=1e-6)
    length = np.hypot(128, 127)
    turns = [[0, 1, 0, 0], [-128 / length, 0, 0, 127 / length]]
    np.testing.assert_allclose(cloud.rotations, turns, atol=1e-7)
    assert (capture.format, capture.frame, cloud.sh_degree) == ("SPLAT", "rdf", 0)


def test_what_is_written_comes_back_within_the_bounds(tmp_path):
    """Oracle: half a step of each byte: 1/510, 0.9 degrees = 4 components of 1/256 each."""
    cloud = random_cloud(20_000, 3)  # more than one block
    cloud = dataclasses.replace(cloud, sh=np.clip(cloud.sh, -1.77, 1.77))
    formats.write(cloud, tmp_path / "a.splat")
    again = formats.read(tmp_path / "a.splat").cloud
    weight = np.prod(cloud.scales.astype(np.float64), axis=1) * cloud.opacities
    order = np.argsort(-weight, kind="stable")
    np.testing.assert_array_equal(again.positions, cloud.positions[order])
    np.testing.assert_array_equal(again.scales, cloud.scales[order])
    kept = {name: getattr(cloud, name)[order] for name in ("positions", "scales", "rotations")}
    sent = dataclasses.replace(
        cloud, **kept, opacities=cloud.opacities[order], sh=cloud.sh[order, :1]
    )
    apart = differences(again, sent)
    assert apart.opacity <= 1 / 509
    assert apart.dc <= 1 / 509 / C0
    assert 0.4 < apart.rotation <= 0.9


def test_the_splats_that_matter_most_come_first(tmp_path):
    """Oracle: volume times opacity is 8, 4, 1 and 1 / 2; equals keep their order."""
    cloud = random_cloud(5, 0)
    sizes = np.float32([[1, 1, 1], [2, 2, 2], [1, 1, 1], [1, 2, 4], [1, 1, 1]])
    cloud = dataclasses.replace(cloud, scales=sizes, opacities=np.float32([0.5, 0.5, 1, 1, 0.5]))
    formats.write(cloud, tmp_path / "a.splat")
    again = formats.read(tmp_path / "a.splat").cloud
    np.testing.assert_array_equal(again.positions, cloud.positions[[3, 1, 2, 0, 4]])


def test_colours_that_a_byte_cannot_hold_are_clamped(tmp_path):
    """Oracle: bytes 0 and 255."""
    cloud = random_cloud(2, 0)
    cloud = dataclasses.replace(cloud, sh=np.float32([[[9, 9, 9]], [[-9, -9, -9]]]))
    formats.write(cloud, tmp_path / "a.splat")
    colors = formats.read(tmp_path / "a.splat").cloud.sh * C0 + 0.5
    np.testing.assert_allclose(np.sort(colors, axis=None), [0, 0, 0, 1, 1, 1], atol=1e-6)


def test_the_defining_layout_decodes_as_splat_transform_decodes_it(data):
    """Oracle: splat-transform's decoding. It takes a rotation byte as q / 255 * 2 - 1, where the
    viewer that defines the layout has (q - 128) / 128: up to a degree."""
    ours = formats.read(data / "oracle" / "ours.splat").cloud
    apart = differences(ours, formats.read(data / "oracle" / "rt_splat.ply").cloud)
    assert max(apart.position, apart.log_scale, apart.opacity, apart.dc) < 2e-6
    assert apart.rotation < 1
    source = formats.read(data / "oracle" / "tiny.ply").cloud
    np.testing.assert_array_equal(ours.positions, source.positions)
    assert np.abs(ours.opacities - source.opacities).max() <= 1 / 254
    assert np.abs(ours.sh[:, 0] - np.clip(source.sh[:, 0], -0.5 / C0, 0.5 / C0)).max() < 0.014


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "found 0 bytes, expected 32 for each splat"),
        (bytes(33), "found 33 bytes, expected 32 for each splat"),
        (record() + record(size=(1, 1, -0.5)), "scales of splat 1: found -0.5, expected a number"),
        (record(place=(0, np.nan, 0)), "positions of splat 0: found nan, expected a finite number"),
        (record(size=(np.inf, 1, 1)), "scales of splat 0: found inf"),
    ],
)
def test_what_no_writer_makes_is_refused(tmp_path, data, message):
    """Oracle: the first thing that is wrong."""
    (tmp_path / "a.splat").write_bytes(data)
    with pytest.raises(FormatError, match=message):
        formats.read(tmp_path / "a.splat")


def test_damaged_records_can_be_left_out(tmp_path):
    """Oracle: three of five records are sound, one of them of scale 0, which is legal."""
    bad = (record(size=(1, -1, 1)), record(place=(np.inf, 0, 0)))
    turnless = record(turn=(128,) * 4)
    (tmp_path / "a.splat").write_bytes(
        record() + bad[0] + turnless + bad[1] + record(size=(0, 1, 1)) + record(place=(7, 7, 7))
    )
    capture = formats.read(tmp_path / "a.splat", how=ReadOptions(drop_nonfinite=True))
    np.testing.assert_array_equal(capture.cloud.positions[:, 0], [1, 1, 7])
    assert "splats dropped because they contain a number that is not finite: 2" in capture.notes
    assert "splats dropped because their rotation is zero: 1" in capture.notes


def test_no_splats_are_no_file(tmp_path):
    """Oracle: a file of 0 bytes says nothing, so none is left behind."""
    with pytest.raises(OutputError, match="no splat to write, expected at least one"):
        formats.write(random_cloud(0, 0), tmp_path / "a.splat")
    assert list(tmp_path.iterdir()) == []
