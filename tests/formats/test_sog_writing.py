"""Tests of writing SOG and reading it back."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from tests.formats.compare import differences
from tests.formats.samples import random_cloud
from usdsplat import formats
from usdsplat.core import morton
from usdsplat.core.errors import OutputError
from usdsplat.core.sh import C0
from usdsplat.formats import webp


def in_order(cloud):
    """The cloud in the order in which it is written."""
    order = morton.order(cloud.positions)
    fields = ("positions", "scales", "rotations", "opacities", "sh")
    return replace(cloud, **{field: getattr(cloud, field)[order] for field in fields})


def half_steps(values, table):
    """For each value, half of the interval of an ascending table that holds it."""
    table = np.array(table)
    place = np.clip(np.searchsorted(table, values), 1, len(table) - 1)
    return np.maximum((table[place] - table[place - 1]) / 2, 0) + 1e-6


def meta_of(path):
    with zipfile.ZipFile(path) as archive:
        return json.loads(archive.read("meta.json"))


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("count", [1, 14, 1000])
def test_what_is_read_is_within_the_bounds_of_what_was_written(tmp_path, count, degree):
    """Oracle: half a step of 16 and of 8 bits, half an interval of the file's own tables; the turn
    of 8 bits by the formula of `core.encoding`."""
    cloud = in_order(random_cloud(count, degree))
    path = tmp_path / "a.sog"
    formats.write(cloud, path)
    read = formats.read(path).cloud
    meta = meta_of(path)
    logarithms = [np.copysign(np.log1p(np.abs(c.positions)), c.positions) for c in (cloud, read)]
    step = np.ptp(logarithms[0], axis=0) / 65535
    assert np.all(np.abs(logarithms[0] - logarithms[1]) <= step / 2 + 1e-6)
    logs = np.log(cloud.scales)
    assert np.all(
        np.abs(np.log(read.scales) - logs) <= half_steps(logs, meta["scales"]["codebook"])
    )
    dc = np.abs(read.sh[:, 0] - cloud.sh[:, 0])
    assert np.all(dc <= half_steps(cloud.sh[:, 0], meta["sh0"]["codebook"]))
    apart = differences(read, cloud)
    assert apart.opacity <= 1 / 509
    assert apart.rotation <= np.degrees(4 * np.sqrt(3) * np.sqrt(0.5) / 255)
    assert read.sh_degree == degree


def test_the_oracle_capture_errs_no_more_than_splat_transform_does(data, tmp_path):
    """Oracle: the errors that specs/formats.md measured of splat-transform's file of this cloud;
    for the palette, those of that file itself."""
    source = formats.read(data / "oracle" / "tiny.ply").cloud
    theirs = formats.read(data / "oracle" / "out.sog").cloud
    formats.write(source, tmp_path / "a.sog")
    ours = formats.read(tmp_path / "a.sog").cloud
    source = in_order(source)
    apart = differences(ours, source)
    assert apart.position <= 5.4e-4
    assert apart.log_scale <= 0.010
    assert apart.rotation <= 1.42
    assert apart.opacity <= 1 / 509
    assert apart.dc * C0 <= 0.0025
    near = [np.linalg.norm(theirs.positions - place, axis=1).argmin() for place in source.positions]
    rms = [np.sqrt(np.mean((sh - source.sh)[:, 1:] ** 2)) for sh in (ours.sh, theirs.sh[near])]
    assert rms[0] <= rms[1] * 1.02


def test_a_palette_of_a_real_capture_is_written_with_little_error(data, tmp_path):
    """Oracle: the harmonics that were read from a file with a palette of its own."""
    source = formats.read(data / "splats" / "playbot_lod4.sog").cloud
    formats.write(source, tmp_path / "a.sog")
    ours = formats.read(tmp_path / "a.sog").cloud
    rest = in_order(source).sh[:, 1:]
    error = np.sqrt(np.mean((ours.sh[:, 1:] - rest) ** 2))
    assert error < 0.25 * np.sqrt(np.mean(rest**2))


def test_few_colours_and_sizes_come_back_exactly(tmp_path):
    """Oracle: tables of 256 hold them; a palette of as many entries as splats holds their bands."""
    cloud = random_cloud(64, 2)
    cloud = in_order(replace(cloud, scales=np.float32([[0.5, 2.0, 1.0]] * 64)))
    formats.write(cloud, tmp_path / "a.sog")
    read = formats.read(tmp_path / "a.sog").cloud
    np.testing.assert_allclose(read.scales, cloud.scales, rtol=1e-6)
    np.testing.assert_allclose(read.sh[:, 0], cloud.sh[:, 0], atol=1e-6)


def test_flat_and_empty_clouds_are_written(tmp_path):
    """Oracle: no range on an axis, a scale of 0, no splats at all."""
    cloud = random_cloud(300, 1)
    positions = cloud.positions.copy()
    positions[:, 1] = 2.5
    scales = cloud.scales.copy()
    scales[:, 2] = 0
    formats.write(replace(cloud, positions=positions, scales=scales), tmp_path / "flat.sog")
    read = formats.read(tmp_path / "flat.sog").cloud
    np.testing.assert_allclose(read.positions[:, 1], 2.5, rtol=1e-6)
    assert read.scales[:, 2].max() <= np.exp(-19.9)
    formats.write(random_cloud(0, 3), tmp_path / "none.sog")
    assert len(formats.read(tmp_path / "none.sog").cloud) == 0


def test_the_colour_of_invisible_splats_stays(tmp_path):
    """Oracle: opacity 0 is alpha 0, and encoders forget colours there unless told."""
    cloud = in_order(replace(random_cloud(200, 0), opacities=np.zeros(200, np.float32)))
    formats.write(cloud, tmp_path / "a.sog")
    apart = differences(formats.read(tmp_path / "a.sog").cloud, cloud)
    assert apart.dc < 0.05 and apart.opacity == 0


def test_the_archive_is_as_other_readers_want_it(tmp_path):
    """Oracle: formats.md 2.5: stored entries, the names of the format, images that hold the count,
    a palette 64 entries wide, labels of 16 bits."""
    from PIL import Image

    formats.write(random_cloud(3000, 3), tmp_path / "a.sog")
    meta = meta_of(tmp_path / "a.sog")
    assert (meta["version"], meta["count"]) == (2, 3000)
    assert meta["shN"]["bands"] == 3 and meta["shN"]["count"] <= 2048
    with zipfile.ZipFile(tmp_path / "a.sog") as archive:
        kinds = {info.compress_type for info in archive.infolist()}
        sizes = {
            name: Image.open(io.BytesIO(archive.read(name))).size
            for name in archive.namelist()
            if name.endswith(".webp")
        }
    assert kinds == {zipfile.ZIP_STORED}
    plain = ("means_l", "means_u", "scales", "quats", "sh0", "shN_labels")
    assert {sizes[f"{name}.webp"] for name in plain} == {(56, 54)}
    assert sizes["shN_centroids.webp"] == (960, 32)
    for name in ("scales", "sh0", "shN"):
        assert len(meta[name]["codebook"]) == 256


@pytest.mark.parametrize("antialiased", [False, True])
def test_the_projection_is_written_and_equal_clouds_are_equal_files(tmp_path, antialiased):
    """Oracle: what was asked for; the bytes of a second file."""
    how = formats.WriteOptions(antialiased=antialiased)
    for name in ("a.sog", "b.sog"):
        formats.write(random_cloud(50, 1), tmp_path / name, how=how)
    assert formats.read(tmp_path / "a.sog").antialiased is antialiased
    assert (tmp_path / "a.sog").read_bytes() == (tmp_path / "b.sog").read_bytes()


def test_a_folder_is_written_and_replaced(tmp_path):
    """Oracle: the archive of the same clouds; the files that `meta.json` names, and no others."""
    meta = tmp_path / "scan" / "meta.json"
    for seed in range(3):
        formats.write(random_cloud(30, 1, seed), meta)
        formats.write(random_cloud(30, 1, seed), tmp_path / "a.sog")
        capture = formats.read(meta)
        np.testing.assert_array_equal(
            capture.cloud.positions, formats.read(tmp_path / "a.sog").cloud.positions
        )
        assert sorted(capture.files) == sorted((tmp_path / "scan").iterdir())


def test_other_files_of_a_folder_are_left_alone(tmp_path):
    """Oracle: their bytes; a folder without a SOG is no place for one."""
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="a folder with other files, expected a new or an empty"):
        formats.write(random_cloud(5, 0), tmp_path / "meta.json")
    formats.write(random_cloud(5, 0), tmp_path / "scan" / "meta.json")
    (tmp_path / "scan" / "notes.txt").write_text("mine")
    formats.write(random_cloud(6, 0), tmp_path / "scan" / "meta.json")
    assert (tmp_path / "scan" / "notes.txt").read_text() == "mine"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "meta.json").write_text('{"title": "mine"}')
    with pytest.raises(OutputError, match=r"a meta.json of something else"):
        formats.write(random_cloud(5, 0), tmp_path / "other" / "meta.json")
    assert (tmp_path / "other" / "meta.json").read_text() == '{"title": "mine"}'
    with pytest.raises(OutputError, match=r"a file notes.txt, expected"):
        formats.write(random_cloud(5, 0), tmp_path / "notes.txt" / "meta.json")
    with pytest.raises(OutputError, match="no such file or directory"):
        formats.write(random_cloud(5, 0), tmp_path / "no" / "where" / "meta.json")


@pytest.mark.parametrize("existing", [False, True])
def test_an_interrupted_folder_is_as_it_was(tmp_path, monkeypatch, existing):
    """Oracle: the files from before, none if there were none."""
    meta = tmp_path / "scan" / "meta.json"
    if existing:
        formats.write(random_cloud(30, 1), meta)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    monkeypatch.setattr("os.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        formats.write(random_cloud(40, 1, 1), meta)
    after = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert after == before
    assert meta.parent.exists() is existing


def interrupted(*_paths):
    raise KeyboardInterrupt


def test_what_a_killed_writer_left_is_replaced(tmp_path):
    """Oracle: the listing of a folder that was not left by anybody; images without `meta.json`,
    under their own and under numbered names."""
    formats.write(random_cloud(30, 1), tmp_path / "new" / "meta.json")
    (tmp_path / "left").mkdir()
    for name in ("means_l.webp", "sh0.1.webp"):
        (tmp_path / "left" / name).write_bytes(b"half")
    formats.write(random_cloud(30, 1), tmp_path / "left" / "meta.json")
    found, expected = (len(list((tmp_path / name).iterdir())) for name in ("left", "new"))
    assert found == expected
    assert len(formats.read(tmp_path / "left" / "meta.json").cloud) == 30


def test_progress_ends_with_every_splat(tmp_path):
    """Oracle: the number of splats."""
    steps = []

    class Listener:
        def step(self, label, done, total):
            steps.append((done, total))

    formats.write(random_cloud(500, 2), tmp_path / "a.sog", progress=Listener())
    assert steps == sorted(steps) and steps[-1] == (500, 500)


@pytest.mark.parametrize("count", [0, 1, 16, 17, 1_000_000, 16383**2])
def test_images_are_nearly_square_and_no_wider_than_encoders_take(count):
    """Oracle: arithmetic; WebP's 14 bits a side."""
    width, height = webp.size_for(count)
    assert width * height >= count and max(width, height) <= 16383
    assert width * (height - 1) < max(count, 1) and abs(width - height) <= 8
    with pytest.raises(ValueError, match="expected at most"):
        webp.size_for(16383**2 + 1)
