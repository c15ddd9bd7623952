"""Tests of binary glTF, with files and readers of other projects."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from tests.formats.compare import differences
from tests.formats.gltf_samples import of_cloud
from tests.formats.samples import random_cloud
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.errors import FormatError, OutputError, UsageError
from usdsplat.formats.gltf import glb


def chunks(data):
    """JSON and binary chunk of a file whose lengths are true."""
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    rest, binary = struct.unpack_from("<I4s", data, 20 + size)
    assert (binary, rest) == (b"BIN\0", len(data) - size - 28)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def test_a_file_of_splat_transform_is_its_capture_upright(data):
    """Oracle: the capture that splat-transform was given; it turns by 180 degrees about z."""
    capture = formats.read(data / "oracle" / "out.glb")
    source = formats.read(data / "oracle" / "tiny.ply").cloud
    apart = differences(capture.cloud, edit.transform(source, np.diag([-1, -1, 1, 1])))
    assert max(apart.position, apart.log_scale, apart.opacity, apart.dc, apart.harmonics) < 1e-6
    assert apart.rotation < 1e-4
    assert (capture.format, capture.frame, capture.notes) == ("GLB 2.0", "rub", ())
    assert capture.color_space == "srgb_rec709_scene"
    assert capture.files == (data / "oracle" / "out.glb",)


@pytest.mark.parametrize("degree", range(4))
def test_what_is_written_is_read_again_exactly(tmp_path, degree):
    """Oracle: the cloud; floats stay as they are but for the length of a rotation."""
    cloud = random_cloud(20_000, degree)  # more than a block
    glb.write(cloud, tmp_path / "a.glb")
    again = formats.read(tmp_path / "a.glb").cloud
    for name in ("positions", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(again, name), getattr(cloud, name))
    np.testing.assert_allclose(again.rotations, cloud.rotations, atol=1e-6)


def test_the_bytes_are_where_an_independent_reader_looks(tmp_path):
    """Oracle: the layout of glTF 2.0, read with struct and NumPy alone."""
    cloud = random_cloud(37, 1)
    glb.write(cloud, tmp_path / "a.glb")
    root, binary = chunks((tmp_path / "a.glb").read_bytes())
    (primitive,) = root["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    assert root["buffers"] == [{"byteLength": len(binary)}]

    def values(name, dtype):
        accessor = root["accessors"][primitive["attributes"][name]]
        view = root["bufferViews"][accessor["bufferView"]]
        assert accessor["count"] == 37 and view["byteOffset"] % 4 == 0
        data = binary[view["byteOffset"] :][: view["byteLength"]]
        return np.frombuffer(data, dtype).reshape(37, -1)

    own = "KHR_gaussian_splatting:"
    np.testing.assert_array_equal(values("POSITION", "<f4"), cloud.positions)
    np.testing.assert_array_equal(values(f"{own}SCALE", "<f4"), cloud.scales)
    np.testing.assert_array_equal(values(f"{own}OPACITY", "<f4")[:, 0], cloud.opacities)
    turned = values(f"{own}ROTATION", "<f4")  # x, y, z, w
    np.testing.assert_array_equal(turned[:, 3], cloud.rotations[:, 0])
    np.testing.assert_array_equal(turned[:, :3], cloud.rotations[:, 1:])
    np.testing.assert_array_equal(values(f"{own}SH_DEGREE_1_COEF_2", "<f4"), cloud.sh[:, 3])
    position = root["accessors"][primitive["attributes"]["POSITION"]]
    assert np.float32(position["min"]).tolist() == cloud.positions.min(axis=0).tolist()
    assert np.float32(position["max"]).tolist() == cloud.positions.max(axis=0).tolist()


def test_the_document_says_what_splat_transform_says(data, tmp_path):
    """Oracle: splat-transform's own file of the same splats, and its colours for plain viewers."""
    theirs, their_data = chunks((data / "oracle" / "out.glb").read_bytes())
    glb.write(formats.read(data / "oracle" / "out.glb").cloud, tmp_path / "a.glb")
    ours, our_data = chunks((tmp_path / "a.glb").read_bytes())
    assert ours["extensionsUsed"] == theirs["extensionsUsed"]
    mine, other = (root["meshes"][0]["primitives"][0] for root in (ours, theirs))
    assert mine["extensions"] == other["extensions"]
    assert mine["attributes"].keys() == other["attributes"].keys()
    colors = []
    for root, binary in ((ours, our_data), (theirs, their_data)):
        index = root["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]
        accessor = root["accessors"][index]
        assert (accessor["componentType"], accessor["normalized"]) == (5121, True)
        start = root["bufferViews"][accessor["bufferView"]]["byteOffset"]
        colors.append(np.frombuffer(binary, "u1", 4000, start).astype(int))
    assert np.abs(colors[0] - colors[1]).max() <= 1


@pytest.mark.parametrize(
    ("cloud", "how", "found"),
    [
        (random_cloud(3, 4), {}, "harmonics of degree 4"),
        (random_cloud(0, 0), {}, "no splats"),
        (random_cloud(3, 0), {"frame": "rdf"}, "frame 'rdf'"),
    ],
)
def test_what_gltf_cannot_hold_is_refused_and_nothing_written(tmp_path, cloud, how, found):
    """Oracle: the extension's degrees, and glTF's axes and demands on accessors."""
    with pytest.raises(UsageError, match=f"found {found}, expected"):
        formats.write(cloud, tmp_path / "a.glb", how=formats.WriteOptions(**how))
    assert list(tmp_path.iterdir()) == []


def test_more_than_four_gigabytes_are_refused_before_they_are_written(tmp_path):
    """Oracle: the 32 bits of the length; zeros seen again and again take no memory."""
    count = 80_000_000
    zeros = np.broadcast_to(np.float32(0), (count, 3))
    cloud = replace(
        random_cloud(1, 0),
        positions=zeros,
        scales=zeros,
        rotations=np.broadcast_to(np.float32([1, 0, 0, 0]), (count, 4)),
        opacities=zeros[:, 0],
        sh=zeros[:, None],
    )
    with pytest.raises(OutputError, match=r"found 80000000 splats in \d+ bytes"):
        glb.write(cloud, tmp_path / "a.glb")


@pytest.mark.parametrize(
    ("at", "value", "found"),
    [
        (4, 1, "version 1"),
        (8, 1 << 30, r"\d+ bytes"),
        (12, 1 << 30, "a chunk b'JSON' of 1073741824 bytes where"),
        (16, 7, r"a chunk b'\\x07"),
    ],
)
def test_headers_that_lie_are_refused(tmp_path, at, value, found):
    """Oracle: the length of the file."""
    path = of_cloud(random_cloud(5, 0)).glb(tmp_path / "a.glb")
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, at, value)
    path.write_bytes(data)
    with pytest.raises(FormatError, match=f"found .*{found}"):
        formats.read(path)


def test_a_binary_chunk_that_is_cut_or_missing_is_refused(tmp_path):
    """Oracle: what the document counts."""
    sample = of_cloud(random_cloud(5, 0))
    path = sample.glb(tmp_path / "a.glb")
    data = path.read_bytes()
    cut = data[:8] + struct.pack("<I", len(data) - 4) + data[12:-4]
    path.write_bytes(cut)
    with pytest.raises(FormatError, match="a binary chunk of"):
        formats.read(path)
    size = struct.unpack_from("<I", data, 12)[0]
    path.write_bytes(data[:8] + struct.pack("<I", 20 + size) + data[12 : 20 + size])
    with pytest.raises(FormatError, match=f"found 0 bytes, expected {len(sample.data)}"):
        formats.read(path)
    path.write_bytes(data[:19])
    with pytest.raises(FormatError, match="a header of 19 bytes"):
        formats.read(path)
