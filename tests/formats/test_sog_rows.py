"""Tests of reading rows of SOG files."""

from __future__ import annotations

import os
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.formats.samples import random_cloud
from usdsplat import formats
from usdsplat.core.errors import FormatError
from usdsplat.formats.sog import rows as sog_rows
from usdsplat.formats.sog.rows import SogRows, count_and_degree, stamp

FIELDS = ("positions", "scales", "rotations", "opacities", "sh")


def written(folder, name="a.sog", count=50, degree=1, seed=0):
    """A file of random splats."""
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    formats.write(random_cloud(count, degree, seed=seed), path)
    return str(path)


@pytest.mark.parametrize("name", ["a.sog", "a/meta.json"])
def test_rows_are_those_of_the_file(tmp_path, name):
    """Oracle: the file read whole; higher coefficients are 0."""
    path = written(tmp_path, name)
    whole, found = formats.read(path).cloud, SogRows().read(path, 7, 20, 2)
    for field in FIELDS[:4]:
        np.testing.assert_array_equal(getattr(found, field), getattr(whole, field)[7:27])
    np.testing.assert_array_equal(found.sh[:, :4], whole.sh[7:27])
    assert found.sh.shape == (20, 9, 3) and not found.sh[:, 4:].any()
    assert count_and_degree(path) == (50, 1)


def test_a_file_is_unpacked_once_until_it_changes(tmp_path, monkeypatch):
    """Oracle: the number of times that codes are read, by four threads; and the new file."""
    calls = []
    read = sog_rows.read_codes
    monkeypatch.setattr(sog_rows, "read_codes", lambda sog: calls.append(1) or read(sog))
    path, reader = written(tmp_path), SogRows()
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda first: reader.read(path, first, 10, 1), range(40)))
    assert len(calls) == 1
    written(tmp_path, seed=5)
    os.utime(path, ns=(1, 1))
    found = reader.read(path, 0, 50, 1)
    assert len(calls) == 2
    np.testing.assert_array_equal(found.positions, formats.read(path).cloud.positions)


def test_an_image_of_a_folder_that_changes_is_read_again(tmp_path):
    """Oracle: the folder read whole; `meta.json` stays as it is."""
    path, other = written(tmp_path, "a/meta.json"), written(tmp_path, "b/meta.json", seed=5)
    reader, before = SogRows(), stamp(path)
    reader.read(path, 0, 50, 1)
    assert stamp(path) == before
    shutil.copy(os.path.join(os.path.dirname(other), "quats.webp"), os.path.dirname(path))
    assert stamp(path) != before
    found = reader.read(path, 0, 50, 1)
    np.testing.assert_array_equal(found.rotations, formats.read(path).cloud.rotations)
    np.testing.assert_array_equal(found.rotations, formats.read(other).cloud.rotations)


def test_codes_in_memory_have_a_limit(tmp_path, monkeypatch):
    """Oracle: with room for one file, each change of the file unpacks again."""
    calls = []
    read = sog_rows.read_codes
    monkeypatch.setattr(sog_rows, "read_codes", lambda sog: calls.append(1) or read(sog))
    monkeypatch.setattr(sog_rows, "HELD", 1)
    paths, reader = [written(tmp_path, f"{k}.sog") for k in range(2)], SogRows()
    for path in (*paths, *paths):
        reader.read(path, 0, 1, 1)
    assert len(calls) == 4


@pytest.mark.parametrize(("first", "count"), [(-1, 2), (40, 11), (0, 51)])
def test_rows_that_are_not_there_are_refused(tmp_path, first, count):
    """Oracle: the number of splats."""
    with pytest.raises(FormatError, match="50 splats"):
        SogRows().read(written(tmp_path), first, count, 1)


def test_a_higher_degree_is_refused(tmp_path):
    """Oracle: the degree of the file."""
    with pytest.raises(FormatError, match="harmonics of degree 1, expected at most 0"):
        SogRows().read(written(tmp_path), 0, 1, 0)


def test_a_pipe_is_refused(tmp_path):
    """Oracle: nobody writes to the pipe, so that opening it would never return."""
    path = str(tmp_path / "a.sog")
    os.mkfifo(path)
    for work in (count_and_degree, lambda pipe: SogRows().read(pipe, 0, 1, 0)):
        with pytest.raises(FormatError, match="no regular file"):
            work(path)
