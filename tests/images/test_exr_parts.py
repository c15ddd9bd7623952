"""Tests of the parts of an EXR: contents, compression and header entries."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

import usdsplat
from tests.images.exr_file import ExrFile
from tests.images.test_exr import write
from usdsplat.images import cryptomatte
from usdsplat.images.aovs import AOVS
from usdsplat.images.camera import camera_metadata
from usdsplat.images.compression import FLAT_COMPRESSIONS
from usdsplat.images.labels import picture_metadata
from usdsplat.images.layout import ImageLayout

OIIOTOOL = str(Path(sys.executable).with_name("oiiotool"))
NAMES = ["/World/Garden", "/World/prim_293", "/World/prim_590", "/World/prim_1111"]


def everything(rows, columns, seed=0):
    """Random pixels of every AOV there is; Cryptomatte holds real hashes, awkward ones too."""
    rng = np.random.default_rng(seed)
    found = {}
    for name, aov in AOVS.items():
        tail = (len(aov.channels),) if len(aov.channels) > 1 else ()
        if aov.kind == "id":
            found[name] = rng.integers(2**24 + 1, 2**32, (rows, columns), np.uint32)
        else:
            found[name] = rng.uniform(-9, 9, (rows, columns, *tail)).astype(np.float32)
    hashes = np.array([cryptomatte.object_hash(name) for name in NAMES])
    for layer in cryptomatte.LAYERS:
        found[layer][..., ::2] = rng.choice(hashes, (rows, columns, 6))
    return found


def channels_of(pixels):
    """EXR channel -> what was given for it."""
    return {
        channel: np.atleast_3d(pixels[name])[:, :, i]
        for name, aov in AOVS.items()
        for i, channel in enumerate(aov.channels)
    }


def info(path):
    """What oiiotool says about every part."""
    run = subprocess.run([OIIOTOOL, "--info", "-v", "-a", path], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_each_aov_is_a_part_called_as_compositors_expect(tmp_path):
    """Oracle: a byte-level reader of the EXR layout finds names, order, types and all pixels."""
    layout = ImageLayout(resolution=(23, 70), aovs=tuple(AOVS), multipart=True)
    pixels = everything(70, 23)
    write(tmp_path / "a.exr", layout, pixels, compression="none")
    file = ExrFile(tmp_path / "a.exr")
    assert [header["name"][1].decode() for header, _ in file.parts] == [
        *("rgba", "depth", "Zfront", "Zexp", "N", "Naxis", "confidence", "occlusion"),
        *("P", "albedo", "shadow", "irradiance"),
        *("forward", "backward", "cryptoObject", "cryptoAsset", "cryptoMaterial", "ids"),
    ]
    found = {name: array for _, arrays in file.parts for name, array in arrays.items()}
    expected = channels_of(pixels)
    assert found.keys() == expected.keys()
    for name, array in found.items():
        half = name in "RGBA" or name.startswith("albedo")
        dtype = np.float16 if half else expected[name].dtype
        assert array.dtype == dtype
        np.testing.assert_array_equal(array, expected[name].astype(dtype))


@pytest.mark.parametrize("multipart", [False, True])
@pytest.mark.parametrize("compression", FLAT_COMPRESSIONS)
def test_no_compression_changes_a_bit_of_data_or_ids(tmp_path, compression, multipart):
    """Oracle: OpenImageIO's reader, channel by channel; dwa loses by the name of a channel."""
    layout = ImageLayout(resolution=(40, 66), aovs=tuple(AOVS), multipart=multipart)
    pixels = everything(66, 40)
    write(tmp_path / "a.exr", layout, pixels, compression=compression)
    expected = channels_of(pixels)
    exact = {c for aov in AOVS.values() if aov.kind != "color" for c in aov.channels}
    file = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    part = 0
    while file.seek_subimage(part, 0):
        names = file.spec().channelnames
        is_ids = "id" in names
        data = file.read_image(part, 0, 0, len(names), "uint" if is_ids else "float")
        for i, name in enumerate(names):
            if name in exact:
                given = expected[name].view(np.uint32)
                np.testing.assert_array_equal(data[:, :, i].view(np.uint32), given, name)
                exact.remove(name)
        part += 1
    file.close()
    assert not exact


def test_colour_leads_whatever_the_order_asked_for(tmp_path):
    """Oracle: the names of the parts; many readers look at the first alone."""
    layout = ImageLayout(resolution=(4, 4), aovs=("id", "cryptoObject", "Z", "color"))
    write(tmp_path / "a.exr", layout, everything(4, 4), compression="dwaa")
    names = [header["name"][1] for header, _ in ExrFile(tmp_path / "a.exr").parts]
    assert names == [b"main", b"cryptoObject", b"ids"]


def test_data_is_not_called_a_colour(tmp_path):
    """Oracle: the recommendation of the ASWF's Color Interop Forum for EXR: "data" there."""
    layout = ImageLayout(resolution=(4, 4), aovs=tuple(AOVS), multipart=True)
    write(tmp_path / "a.exr", layout, everything(4, 4))
    for header, _ in ExrFile(tmp_path / "a.exr").parts:
        is_color = header["name"][1] in (b"rgba", b"albedo")
        assert header["colorInteropID"][1] == (b"lin_rec709_scene" if is_color else b"data")


@pytest.mark.parametrize("multipart", [False, True])
def test_oiiotool_shows_all_that_the_header_promises(tmp_path, multipart):
    """Oracle: `oiiotool --info -v`, which has its own reader of headers."""
    labels = picture_metadata(stage="shot.usd", frame=12.5, samples=16, exposure=2.0)
    camera = camera_metadata(
        world_to_camera=(1, 0, 0, 4, 0, 1, 0, 5, 0, 0, 1, 6, 0, 0, 0, 1),
        window=(-0.5, -0.25, 0.5, 0.25),
        orthographic=False,
    )
    layout = ImageLayout(
        resolution=(8, 4),
        aovs=tuple(AOVS),
        multipart=multipart,
        color_space="lin_ap1_scene",
        metadata={**labels, **camera, **cryptomatte.metadata("cryptoObject", NAMES)},
    )
    write(tmp_path / "a.exr", layout, everything(4, 8))
    text = info(tmp_path / "a.exr")
    key = f"cryptomatte/{cryptomatte.hash_bits('cryptoObject'):08x}"[:-1]
    for line in (
        'oiio:ColorSpace: "lin_ap1_scene"',
        'colorInteropID: "lin_ap1_scene"',
        "chromaticities: 0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767",
        "worldToCamera: 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 4, 5, -6, 1",
        "worldToNDC: 1, 0, 0, 0, 0, -2, 0, 0, -0.5, -0.5, 0, -1",
        'usdsplat:stage: "shot.usd"',
        "usdsplat:frame: 12.5",
        "usdsplat:samples: 16",
        "usdsplat:exposure: 2",
        f'Software: "usdsplat {usdsplat.__version__}"',
        f'{key}/name: "cryptoObject"',
        f'{key}/hash: "MurmurHash3_32"',
        f'{key}/conversion: "uint32_to_float32"',
        f"{key}/manifest: ",
        *(f"usdsplat:aov:{name}: " for name in AOVS),
    ):
        assert line in text
    assert text.count(f"{key}/name") == 1 + multipart


@pytest.mark.parametrize(
    ("space", "red", "white"),
    [
        ("lin_rec709_scene", (0.64, 0.33), (0.3127, 0.3290)),
        ("lin_ap1_scene", (0.713, 0.293), (0.32168, 0.33767)),
        ("lin_ap0_scene", (0.7347, 0.2653), (0.32168, 0.33767)),
        ("lin_rec2020_scene", (0.708, 0.292), (0.3127, 0.3290)),
        ("lin_p3d65_scene", (0.680, 0.320), (0.3127, 0.3290)),
    ],
)
def test_every_working_space_is_named_with_its_primaries(tmp_path, space, red, white):
    """Oracle: OpenImageIO's reader, and primaries as their standards print them."""
    layout = ImageLayout(resolution=(4, 4), color_space=space)
    write(tmp_path / "a.exr", layout, everything(4, 4))
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert spec.getattribute("oiio:ColorSpace") == space
    assert spec.getattribute("colorInteropID") == space
    found = spec.getattribute("chromaticities")
    assert (*found[:2], *found[6:]) == pytest.approx((*red, *white))


def named_layers(names: dict[str, list[str]]) -> dict[str, str]:
    """The header entries of several Cryptomattes."""
    entries: dict[str, str] = {}
    for layer, each in names.items():
        entries |= {key: str(value) for key, value in cryptomatte.metadata(layer, each).items()}
    return entries


@pytest.mark.parametrize(
    ("multipart", "compression"), [(False, "zip"), (True, "zip"), (False, "dwaa")]
)
def test_several_cryptomattes_are_told_apart(tmp_path, multipart: bool, compression: str) -> None:
    """Oracle: the Cryptomatte specification 1.2: the key of a layer is the first seven hex digits
    of the MurmurHash3 of its name, by mmh3 5.3; the first part names all layers, and a part of its
    own names itself."""
    keys = {"cryptoObject": "1a4aca8", "cryptoAsset": "c94dded", "cryptoMaterial": "6af633d"}
    names = {"cryptoObject": NAMES, "cryptoAsset": NAMES[:1], "cryptoMaterial": ["default"]}
    layout = ImageLayout(
        resolution=(4, 4),
        aovs=("color", *names),
        multipart=multipart,
        compression=compression,
        crypto_rank=3,
        metadata=named_layers(names),
    )
    pixels = everything(4, 4)
    write(
        tmp_path / "a.exr", layout, {k: v[..., :8] for k, v in pixels.items() if k in layout.aovs}
    )
    file, found = oiio.ImageInput.open(str(tmp_path / "a.exr")), []
    while file.seek_subimage(len(found), 0):
        spec = file.spec()
        entries = {item.name: item.value for item in spec.extra_attribs}
        manifests = {k: v for k, v in entries.items() if k.startswith("cryptomatte/")}
        found.append((spec.channelnames, manifests))
    file.close()
    (channels, first), *others = found
    for layer, key in keys.items():
        assert first[f"cryptomatte/{key}/name"] == layer
        assert list(json.loads(first[f"cryptomatte/{key}/manifest"])) == names[layer]
    assert len(first) == 12
    if multipart or compression == "dwaa":
        assert [list(part) for part, _ in others] == [
            [f"{layer}{pair:02d}.{c}" for pair in range(2) for c in "RGBA"] for layer in keys
        ]
        for (_, entries), key in zip(others, keys.values(), strict=True):
            assert {name.split("/")[1] for name in entries} == {key}
            assert len(entries) == 4
    else:
        assert len(channels) == 4 + 3 * 8 and not others
