"""Tests that malicious files give a one-line error and take little memory."""

from __future__ import annotations

import pytest

from tests.formats.gltf_samples import of_spz
from tests.formats.hostile import bombs, zeros_in_gzip
from tests.formats.reading import MEMORY_LIMIT_MB, check_sentence, linux_only, read_in_a_process
from tests.formats.samples import spz_header
from usdsplat.formats.inflate import TRUSTED_COUNT


@linux_only
def test_bombs_are_refused_in_a_sentence_and_little_memory(tmp_path):
    """Oracle: the shape of every error, and the memory that the system counted."""
    paths = bombs(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    for outcome in read_in_a_process(paths):
        check_sentence(outcome)
        assert outcome.peak < MEMORY_LIMIT_MB / 2, outcome
    assert sorted(tmp_path.rglob("*")) == before


@linux_only
def test_files_that_lie_are_refused_in_a_sentence_and_little_memory(data):
    """Oracle: the shape of every error, and the memory that the system counted."""
    paths = sorted((data / "hostile").iterdir())
    assert len(paths) >= 8
    for outcome in read_in_a_process(paths):
        check_sentence(outcome)
        assert outcome.peak < MEMORY_LIMIT_MB / 2, outcome


@linux_only
@pytest.mark.parametrize("name", ["equal.spz", "equal.glb"])
def test_the_largest_claim_that_is_believed_fits_the_memory(tmp_path, name):
    """Oracle: so many equal splats are a legal file, however small; the system counts memory."""
    count = TRUSTED_COUNT // (1 if name == "equal.spz" else 2)
    data = zeros_in_gzip(spz_header(count, degree=4), count * 91)
    (tmp_path / name).write_bytes(data if name == "equal.spz" else of_spz(data).glb_bytes())
    (outcome,) = read_in_a_process([tmp_path / name])
    assert (outcome.splats, outcome.said, outcome.bug) == (count, "", "")
    assert outcome.peak < MEMORY_LIMIT_MB, outcome
