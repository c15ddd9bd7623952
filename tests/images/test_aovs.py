"""Tests of the table of AOVs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.aovs import AOVS, CAPTURED, find_aovs, is_light, light_name


def test_aovs_are_found_in_a_files_words_and_in_hydras():
    """Oracle: the names of the rendering specification, beside Hydra's HdAovTokens."""
    assert find_aovs(("Z", "id", "splatId")) == find_aovs(("depth", "primId", "elementId"))
    assert find_aovs(("color",))[0].channels == ("R", "G", "B", "A")


def test_no_channel_has_two_meanings():
    """Oracle: an EXR part holds a channel name once."""
    channels = [name for aov in AOVS.values() for name in aov.channels]
    assert len(channels) == len(set(channels))


def test_channels_are_called_what_compositors_look_for():
    """Oracle: the table of the rendering specification."""
    found = {n: ",".join(aov.channels) for n, aov in AOVS.items() if not aov.is_cryptomatte}
    assert found == {
        "color": "R,G,B,A",
        "Z": "Z",
        "Zfront": "Zfront",
        "Zexp": "Zexp",
        "N": "N.x,N.y,N.z",
        "Naxis": "Naxis.x,Naxis.y,Naxis.z",
        "confidence": "confidence",
        "occlusion": "occlusion",
        "P": "P.x,P.y,P.z",
        "albedo": "albedo.R,albedo.G,albedo.B",
        "shadow": "shadow.R,shadow.G,shadow.B",
        "irradiance": "irradiance.R,irradiance.G,irradiance.B",
        "forward": "forward.u,forward.v",
        "backward": "backward.u,backward.v",
        "id": "id",
        "instanceId": "instanceId",
        "splatId": "splatId",
    }


@pytest.mark.parametrize("layer", ["cryptoObject", "cryptoAsset", "cryptoMaterial"])
@pytest.mark.parametrize(("rank", "pairs"), [(2, 1), (3, 2), (6, 3), (7, 4), (16, 8)])
def test_channels_of_a_cryptomatte_hold_two_ranks_each(layer: str, rank: int, pairs: int) -> None:
    """Oracle: the Cryptomatte specification: layers are numbered from 00, with RGBA each, of which
    RG and BA are an id and its coverage."""
    aov = AOVS[layer].with_rank(rank)
    assert aov.channels == tuple(f"{layer}{pair:02d}.{c}" for pair in range(pairs) for c in "RGBA")
    assert AOVS[layer].channels == AOVS[layer].with_rank(6).channels
    assert replace(aov, channels=()) == replace(AOVS[layer], channels=())


def test_other_aovs_have_no_ranks() -> None:
    """Oracle: their tables of channels."""
    for aov in AOVS.values():
        assert aov.is_cryptomatte == aov.name.startswith("crypto")
        assert aov.is_cryptomatte or aov.with_rank(9) is aov


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


@pytest.mark.parametrize(
    ("group", "name"),
    [
        ("key", "light_key"),
        ("Rim light", "light_Rim_light"),
        ("window.left", "light_window_left"),
        ("für", "light_f_r"),
        ("captured", "light_captured_"),
    ],
)
def test_a_light_group_has_a_name_that_layers_can_have(group, name):
    """Oracle: layers of Nuke and EXR: ASCII letters, digits, underscores, no full stop."""
    assert light_name(group) == name and is_light(name) and name != CAPTURED
    (aov,) = find_aovs((name,))
    assert aov.channels == (f"{name}.R", f"{name}.G", f"{name}.B") and aov.kind == "color"


def test_names_of_light_groups_are_no_other_aovs():
    """Oracle: the table."""
    assert not any(map(is_light, AOVS))
    for wrong in ("light_", "light_a.b", "lights", "light_*"):
        assert not is_light(wrong)
