"""The table of AOVs."""

from __future__ import annotations

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.aovs import AOVS, find_aovs


def test_aovs_are_found_in_a_files_words_and_in_hydras():
    """Oracle: the names of the rendering specification, beside Hydra's HdAovTokens."""
    assert find_aovs(("Z", "id", "splatId")) == find_aovs(("depth", "primId", "elementId"))
    assert find_aovs(("color",))[0].channels == ("R", "G", "B", "A")


def test_no_channel_has_two_meanings():
    """Oracle: an EXR part holds a channel name once."""
    channels = [name for aov in AOVS.values() for name in aov.channels]
    assert len(channels) == len(set(channels))


@pytest.mark.parametrize("names", [(), ("Z", "depth"), ("beauty",)])
def test_lists_that_make_no_sense_are_refused(names):
    """Oracle: one sentence, where: found X, expected Y."""
    with pytest.raises(UsageError, match=r"--aovs: found .*, expected one"):
        find_aovs(names, where="--aovs")
