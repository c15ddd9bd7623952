"""Tests of streamed SOG: trees made by hand over files with known splats."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from tests.formats.samples import random_cloud, sog_files, with_meta, zipped
from usdsplat import formats
from usdsplat.core.errors import FormatError, UsageError

FIELDS = ("positions", "scales", "rotations", "opacities", "sh")


def leaf(**lods):
    """A leaf: level -> (file, offset, count)."""
    names = ("file", "offset", "count")
    return {"lods": {k[1:]: dict(zip(names, v, strict=True)) for k, v in lods.items()}}


def scene(folder, **changes):
    """Two levels: the finer in a folder and an archive, the coarser in an archive, 14 splats each.

    Of the folder, splats 3 to 5 belong to nothing.
    """
    (folder / "0_0").mkdir()
    for name, data in sog_files(0, bands=2).items():
        (folder / "0_0" / name).write_bytes(data)
    zipped(folder / "0_1.sog", with_meta(sog_files(1), shN=None))
    zipped(folder / "1_0.sog", sog_files(2))
    near = {"children": [leaf(l0=(0, 0, 2), l1=(2, 0, 4)), leaf(l0=(0, 6, 8))]}
    far = leaf(l0=(1, 0, 14), l1=(2, 4, 10))
    meta = {
        "version": 1,
        "lodLevels": 2,
        "counts": [25, 14],
        "filenames": ["0_0/meta.json", "0_1.sog", "1_0.sog"],
        "tree": {"children": [far, {"children": [near, leaf(l0=(0, 2, 1))]}]},
    } | changes
    kept = {key: value for key, value in meta.items() if value is not None}
    path = folder / "lod-meta.json"
    path.write_text(json.dumps(kept))
    return path


def lod(level):
    return formats.ReadOptions(lod=level)


def test_a_level_is_the_ranges_of_its_files(tmp_path):
    """Oracle: the same files read alone; a file without harmonics has zeros."""
    path = scene(tmp_path)
    fine, folder = formats.read(path), formats.read(tmp_path / "0_0")
    archive = formats.read(tmp_path / "0_1.sog")
    rows = [0, 1, 2, *range(6, 14)]
    assert (len(fine.cloud), fine.cloud.sh_degree, fine.format) == (25, 2, "streamed SOG 2")
    for field in FIELDS:
        first = getattr(folder.cloud, field)[rows]
        np.testing.assert_array_equal(getattr(fine.cloud, field)[:11], first)
    np.testing.assert_array_equal(fine.cloud.positions[11:], archive.cloud.positions)
    np.testing.assert_array_equal(fine.cloud.sh[11:, :1], archive.cloud.sh)
    assert not fine.cloud.sh[11:, 1:].any()
    assert set(fine.files) == {path, *folder.files, *archive.files}
    assert "level 0 of 2, which have 25, 14 splats" in fine.notes
    coarse = formats.read(path, how=lod(1))
    for field in FIELDS:
        whole = getattr(formats.read(tmp_path / "1_0.sog").cloud, field)
        np.testing.assert_array_equal(getattr(coarse.cloud, field), whole)


def test_a_folder_and_files_before_version_1_are_read(tmp_path):
    """Oracle: the file itself; splat-transform's older ones have neither version nor counts."""
    path = scene(tmp_path)
    cloud = formats.read(path).cloud
    np.testing.assert_array_equal(formats.read(tmp_path).cloud.positions, cloud.positions)
    meta = json.loads(path.read_text())
    del meta["version"], meta["counts"]
    path.write_text(json.dumps(meta | {"environment": "env/meta.json"}))
    capture = formats.read(path)
    np.testing.assert_array_equal(capture.cloud.positions, cloud.positions)
    assert "its environment, env/meta.json, is a separate capture" in capture.notes


def test_real_captures_are_read_as_levels(data, tmp_path):
    """Oracle: one subject's own files of three levels of detail."""
    names = [f"playbot_lod{level}.sog" for level in (4, 5, 6)]
    alone = []
    for name in names:
        shutil.copy(data / "splats" / name, tmp_path / name)
        alone.append(formats.read(data / "splats" / name).cloud)
    lods = {f"l{i}": (i, 0, len(cloud)) for i, cloud in enumerate(alone)}
    tree = {"lodLevels": 3, "filenames": names, "tree": leaf(**lods)}
    (tmp_path / "lod-meta.json").write_text(json.dumps(tree))
    for level, cloud in enumerate(alone):
        found = formats.read(tmp_path, how=lod(level)).cloud
        for field in FIELDS:
            np.testing.assert_array_equal(getattr(found, field), getattr(cloud, field))


def test_many_small_ranges_are_read_at_once(tmp_path):
    """Oracle: every other splat of the file; a range for each must not cost a start of threads."""
    cloud = random_cloud(20_000, 0)
    formats.write(cloud, tmp_path / "a.sog")
    leaves = [leaf(l0=(0, i, 1)) for i in range(0, 20_000, 2)]
    meta = {"lodLevels": 1, "filenames": ["a.sog"], "tree": {"children": leaves}}
    (tmp_path / "lod-meta.json").write_text(json.dumps(meta))
    whole = formats.read(tmp_path / "a.sog").cloud
    found = formats.read(tmp_path / "lod-meta.json").cloud
    np.testing.assert_array_equal(found.positions, whole.positions[::2])


@pytest.mark.parametrize("level", [-1, 2, 99])
def test_a_level_that_is_not_there_is_refused(tmp_path, level):
    """Oracle: the levels that are."""
    with pytest.raises(UsageError, match=f"found no level {level}, expected a level from 0 to 1"):
        formats.read(scene(tmp_path), how=lod(level))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 2}, "version: found 2"),
        ({"lodLevels": None}, "lodLevels: found None"),
        ({"lodLevels": 0}, "lodLevels: found 0"),
        ({"lodLevels": 1}, "level '1': found .* expected a range of a level below 1"),
        ({"counts": [25, 15]}, r"counts: found \[25, 15\], expected \[25, 14\]"),
        ({"filenames": "0_0"}, "filenames: found '0_0'"),
        ({"filenames": ["0_0/meta.json"] * 3}, "a name twice"),
        ({"filenames": ["../a.sog", "b.sog", "c.sog"]}, r"found '../a.sog', expected a .sog"),
        ({"filenames": ["/a.sog", "b.sog", "c.sog"]}, r"found '/a.sog'"),
        ({"filenames": ["a/./a.sog", "b.sog", "c.sog"]}, r"found 'a/./a.sog'"),
        ({"filenames": ["c:a.sog", "b.sog", "c.sog"]}, r"found 'c:a.sog'"),
        ({"filenames": ["a\\a.sog", "b.sog", "c.sog"]}, r"in or below the same folder"),
        ({"filenames": [7, "b.sog", "c.sog"]}, "found 7"),
        ({"filenames": ["a.ply", "b.sog", "c.sog"]}, r"found 'a.ply'"),
        ({"filenames": ["no/meta.json", "0_1.sog", "1_0.sog"]}, "no file 'no/meta.json'"),
        ({"filenames": ["q" * 300 + ".sog", "0_1.sog", "1_0.sog"]}, "no file 'qqq"),
        ({"environment": "../env.sog"}, r"environment: found '../env.sog'"),
        ({"tree": None}, "tree: found None"),
        ({"tree": {"children": [7]}}, "tree: found 7"),
        ({"tree": {"children": {}}}, "a node with lods or children"),
        ({"tree": {"lods": {"x": {}}}}, "level 'x': found"),
        ({"tree": leaf(l0=(3, 0, 1))}, "file: found 3, expected a whole number from 0 to 2"),
        ({"tree": leaf(l0=(0, -1, 1))}, "offset: found -1"),
        ({"tree": leaf(l0=(0, 0, 1.5))}, "count: found 1.5"),
        ({"tree": leaf(l0=(0, 0, 15)), "counts": None}, "splat 14 of 0_0/meta.json, expected one"),
        (
            {"tree": {"children": [leaf(l0=(0, 0, 5)), leaf(l0=(0, 4, 2))]}, "counts": None},
            r"splat 4 of 0_0/meta.json twice",
        ),
    ],
)
def test_a_tree_that_lies_is_refused(tmp_path, changes, message):
    """Oracle: what is wrong with it."""
    with pytest.raises(FormatError, match=message) as caught:
        formats.read(scene(tmp_path, **changes))
    assert len(str(caught.value)) < 400


def test_deep_and_long_trees_are_refused_or_read(tmp_path):
    """Oracle: Python's own stack is no limit of a loop, its parser's is; a bound of bytes."""
    path = scene(tmp_path)
    path.write_text('{"children": [' * 100_000)
    with pytest.raises(FormatError, match="text that is not JSON"):
        formats.read(path)
    path.write_bytes(b" " * ((1 << 25) + 1))
    with pytest.raises(FormatError, match="found over 33554432 bytes"):
        formats.read(path)
    path.write_bytes(b"\xff{")
    with pytest.raises(FormatError, match="text that is not JSON"):
        formats.read(path)


def test_files_that_claim_more_than_they_can_hold_are_refused_together(tmp_path):
    """Oracle: each is within the bound of one file, all of them are not."""
    names = [f"{i}.sog" for i in range(3)]
    for name in names:
        zipped(tmp_path / name, with_meta(sog_files(), count=1 << 19))
    leaves = [leaf(l0=(i, 0, 1 << 19)) for i in range(3)]
    meta = {"lodLevels": 1, "filenames": names, "tree": {"children": leaves}}
    (tmp_path / "lod-meta.json").write_text(json.dumps(meta))
    with pytest.raises(FormatError, match="1572864 splats in"):
        formats.read(tmp_path)
