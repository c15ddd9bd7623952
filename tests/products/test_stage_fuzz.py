"""Fuzz test of stages: whatever is on them, commands end with findings or with a sentence."""

from __future__ import annotations

import pytest

from tests.products import stage_fuzz
from tests.products.stage_mutations import sources

FEW = 60

pytestmark = pytest.mark.wrong_stages


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """The valid stages that are damaged."""
    return sources(tmp_path_factory.mktemp("originals"))


def test_the_originals_can_be_drawn(originals) -> None:
    """Oracle: the result of each stage without damage."""
    assert {stage_fuzz.ended(path) for path in originals} <= {"drawn", "drawn with findings"}


@pytest.mark.timeout(300)
@pytest.mark.parametrize("first", range(0, FEW, 20))
def test_damaged_stages_end_with_findings_or_a_sentence(first, originals) -> None:
    """Oracle: the errors of usdsplat are the only ones, and no file is left."""
    for seed in range(first, first + 20):
        assert stage_fuzz.checked(seed, originals)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_two_thousand_damaged_stages_end_with_findings_or_a_sentence(monkeypatch) -> None:
    """Oracle: as above, in processes of their own, which do not crash either."""
    monkeypatch.setattr("sys.argv", ["stage_fuzz"])
    assert stage_fuzz.main() == 0
