"""Tests of other projects' files, compared with splat-transform 3.7.0, and of all real captures."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.formats.compare import differences
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError, UsdSplatError

VISIBLE = 1 / 255
"""splat-transform's SOG loses the colour of splats below this opacity."""

SAME = 2e-6
"""Two decoders of the same codes in float32."""

SOURCE_BOUNDS = {
    "out.compressed.ply": (5.7e-3, 1.95e-3, 0.18, 1 / 509, 7e-3, 1 / 63),
    "out_v3.spz": (1.3e-4, 1 / 31.9, 0.2, 1 / 509, 0.0132, 0.067),
    "out_v4.spz": (1.3e-4, 1 / 31.9, 0.2, 1 / 509, 0.0132, 0.067),
    "out.sog": (5.4e-4, 0.0105, 1.42, 1 / 254, 0.009, np.inf),
}
"""File -> greatest errors against what was encoded: position, logarithm of scale, rotation
[degree], opacity, degree 0, harmonics. From specs/formats.md section 2; the palette of a SOG bounds
no single coefficient. Colour bounds are for coefficients, C0 times as large as for colours."""


@pytest.mark.parametrize(
    ("file", "decoded"),
    [
        ("out.compressed.ply", "rt_compressed_ply.ply"),
        ("out.sog", "rt_sog.ply"),
        ("out_v3.spz", "rt_spz_v3.ply"),
        ("out_v4.spz", "rt_spz_v4.ply"),
    ],
)
def test_a_reader_decodes_what_splat_transform_decodes(data, file, decoded):
    """Oracle: splat-transform's own decoding of the file, as a .ply."""
    ours = formats.read(data / "oracle" / file).cloud
    theirs = formats.read(data / "oracle" / decoded).cloud
    keep = theirs.opacities > VISIBLE if file.endswith(".sog") else slice(None)
    apart = differences(ours, theirs, keep)
    assert max(apart.position, apart.log_scale, apart.opacity, apart.dc, apart.harmonics) < SAME
    assert apart.rotation < 1e-3


@pytest.mark.parametrize("file", SOURCE_BOUNDS)
def test_encoding_stays_within_the_published_bounds(data, file):
    """Oracle: the cloud that was encoded, with the bounds that specs/formats.md measured."""
    ours = formats.read(data / "oracle" / file)
    source = formats.read(data / "oracle" / "tiny.ply").cloud
    apart = differences(_in_order(ours.cloud, source), source, source.opacities > VISIBLE)
    found = (
        apart.position,
        apart.log_scale,
        apart.rotation,
        apart.opacity,
        apart.dc,
        apart.harmonics,
    )
    assert np.all(np.array(found) <= SOURCE_BOUNDS[file]), found
    assert set(ours.error_bounds) == {"positions", "scales", "rotations", "opacities", "sh"}


def test_a_sog_folder_is_the_same_as_its_archive(data):
    """Oracle: splat-transform wrote both from one cloud; only its random palettes differ."""
    archive = formats.read(data / "oracle" / "out.sog")
    for path in (data / "oracle" / "sogdir", data / "oracle" / "sogdir" / "meta.json"):
        folder = formats.read(path)
        apart = differences(folder.cloud, archive.cloud)
        assert max(apart.position, apart.log_scale, apart.rotation, apart.opacity, apart.dc) == 0
        assert folder.format == archive.format == "SOG 2"


def test_a_real_sog_decodes_as_its_published_ply(data):
    """Oracle: derived_ply/playbot_lod4_sh2.ply, an exact decoding by splat-transform."""
    ours = formats.read(data / "splats" / "playbot_lod4.sog").cloud
    theirs = formats.read(data / "derived_ply" / "playbot_lod4_sh2.ply").cloud
    apart = differences(ours, theirs)
    assert max(apart.position, apart.log_scale, apart.opacity, apart.dc, apart.harmonics) < SAME


def test_one_capture_in_two_formats_is_one_capture(data):
    """Oracle: statue_angel, exported twice, 180 degrees apart about z; their extents agree."""
    sog = formats.read(data / "splats" / "statue_angel.sog").cloud.positions
    ply = formats.read(data / "splats" / "statue_angel.compressed.ply").cloud.positions
    turned = ply * np.float32([-1, -1, 1])
    for quantile in (0.05, 0.5, 0.95):
        np.testing.assert_allclose(
            np.quantile(turned, quantile, axis=0), np.quantile(sog, quantile, axis=0), atol=5e-3
        )


CAPTURES = {
    "splats/flowers_lod2_0.sog": (92802, 2),
    "splats/flowers_lod3_0.sog": (26895, 2),
    "splats/guitar.compressed.ply": (90854, 0),
    "splats/playbot_lod2.sog": (125000, 2),
    "splats/playbot_lod3.sog": (31000, 2),
    "splats/playbot_lod4.sog": (8406, 2),
    "splats/playbot_lod5.sog": (3000, 2),
    "splats/playbot_lod6.sog": (1873, 2),
    "splats/pod.spz": (101407, 3),
    "splats/statue_angel.compressed.ply": (71377, 0),
    "splats/statue_angel.sog": (71359, 0),
    "splats/statue_massa.sog": (58649, 0),
    "splats/statue_trumpet.sog": (89292, 0),
    **{f"seq_synthetic/monkey_000{frame}.sog": (31658, 0) for frame in range(1, 7)},
}
"""Capture -> count and degree that its header says."""


@pytest.mark.parametrize("file", CAPTURES)
def test_every_capture_loads(data, file):
    """Oracle: the counts and degrees of the files' own headers."""
    capture = formats.read(data / file)
    cloud = capture.cloud
    assert (len(cloud), cloud.sh_degree) == CAPTURES[file]
    assert capture.frame == "rdf"
    for values in (cloud.positions, cloud.scales, cloud.opacities, cloud.sh):
        assert np.isfinite(values).all()
    assert np.abs(np.linalg.norm(cloud.rotations.astype(np.float64), axis=1) - 1).max() < 1e-6
    assert 0 <= cloud.opacities.min() <= cloud.opacities.max() <= 1


def test_no_capture_is_missing_from_the_list(data):
    """Oracle: the folder."""
    folders = (data / "splats", data / "seq_synthetic")
    present = {path.relative_to(data).as_posix() for folder in folders for path in folder.iterdir()}
    assert present == set(CAPTURES)


@pytest.mark.parametrize(
    "file", ["count_huge_small.ply", "count_lies.ply", "count_lies.sog", "count_lies_v3.spz",
             "count_lies_v4.spz", "neg.ply", "trunc.ply", "odd.splat"],
)  # fmt: skip
def test_files_that_lie_are_refused_in_a_sentence(data, file):
    """Oracle: the shape that every error of the package has."""
    with pytest.raises(UsdSplatError) as caught:
        formats.read(data / "hostile" / file)
    text = str(caught.value)
    assert text.startswith(str(data / "hostile" / file))
    assert ": found " in text and ", expected " in text and "\n" not in text


def _in_order(cloud, source):
    """`cloud` with its rows as in `source`: encoders reorder, quantised positions identify."""
    gaps = np.linalg.norm(source.positions[:, None] - cloud.positions[None], axis=2)
    order = np.argmin(gaps, axis=1)
    assert len(set(order)) == len(source)
    fields = ("positions", "scales", "rotations", "opacities", "sh")
    return SplatCloud(**{name: getattr(cloud, name)[order] for name in fields})


@pytest.mark.parametrize(
    "name", ["oracle/out.sog", "oracle/rt_sog.ply", "oracle/sogdir", "splats/pod.spz"]
)
def test_a_capture_knows_what_was_read(data: Path, tmp_path: Path, name: str) -> None:
    """Oracle: the splats of a folder that holds these files and nothing else."""
    capture = formats.read(data / name)
    for path in capture.files:
        shutil.copy(path, tmp_path)
    is_folder = (data / name).is_dir()
    assert (len(capture.files) > 1) == is_folder
    copied = tmp_path if is_folder else tmp_path / Path(name).name
    again = formats.read(copied)
    np.testing.assert_array_equal(again.cloud.sh, capture.cloud.sh)
    assert {path.parent for path in again.files} == {tmp_path}
    for path in again.files[1:]:
        path.rename(tmp_path / "away")
        with pytest.raises(FormatError, match="no file"):
            formats.read(copied)
        (tmp_path / "away").rename(path)
