"""Tests of the table of AOVs."""

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


def test_channels_are_called_what_compositors_look_for():
    """Oracle: the table of the rendering specification; Cryptomatte's ranks hold RGBA each."""
    found = {name: ",".join(aov.channels) for name, aov in AOVS.items() if name != "cryptoObject"}
    assert found == {
        "color": "R,G,B,A",
        "Z": "Z",
        "Zfront": "Zfront",
        "Zexp": "Zexp",
        "N": "N.x,N.y,N.z",
        "P": "P.x,P.y,P.z",
        "albedo": "albedo.R,albedo.G,albedo.B",
        "forward": "forward.u,forward.v",
        "backward": "backward.u,backward.v",
        "id": "id",
        "instanceId": "instanceId",
        "splatId": "splatId",
    }
    crypto = AOVS["cryptoObject"].channels
    assert crypto[::4] == ("cryptoObject00.R", "cryptoObject01.R", "cryptoObject02.R")
    assert crypto[8:] == tuple(f"cryptoObject02.{c}" for c in "RGBA")


def test_only_colour_may_be_kept_as_half():
    """Oracle: the rendering specification; ids are whole numbers, all else is float32."""
    assert [name for name, aov in AOVS.items() if aov.kind == "color"] == ["color", "albedo"]
    ids = [name for name, aov in AOVS.items() if aov.kind == "id"]
    assert ids == ["id", "instanceId", "splatId"]


@pytest.mark.parametrize("names", [(), ("Z", "depth"), ("beauty",)])
def test_lists_that_make_no_sense_are_refused(names):
    """Oracle: one sentence, where: found X, expected Y."""
    with pytest.raises(UsageError, match=r"--aovs: found .*, expected one"):
        find_aovs(names, where="--aovs")
