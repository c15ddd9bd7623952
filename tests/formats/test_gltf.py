"""Tests of glTF documents: all kinds of attributes, nodes, SPZ data, buffers and false sizes."""

from __future__ import annotations

import copy
import os
import struct
from dataclasses import replace

import numpy as np
import pytest

from tests.formats.compare import differences
from tests.formats.gltf_samples import SPLATS, of_cloud, of_spz
from tests.formats.samples import random_cloud, spz
from usdsplat import formats
from usdsplat.core import edit, quaternion
from usdsplat.core.errors import FormatError, UnknownFormatError
from usdsplat.formats.gltf import document

CLOUD = random_cloud(9, 2)


def check_same(cloud, other, atol=0.0):
    """Assert that two clouds hold the same values."""
    for name in ("positions", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(cloud, name), getattr(other, name), atol=atol)
    assert differences(cloud, other).rotation < 1e-4


@pytest.mark.parametrize("place", ["glb", "beside", "alone"])
def test_splats_are_the_same_wherever_the_data_lies(tmp_path, place):
    """Oracle: the cloud that the file was built from."""
    path = tmp_path / ("a.glb" if place == "glb" else "a.gltf")
    capture = formats.read(getattr(of_cloud(CLOUD), place)(path))
    check_same(capture.cloud, CLOUD)
    beside = (tmp_path / "data.bin",) if place == "beside" else ()
    assert capture.files == (path, *beside)
    assert capture.format == ("GLB 2.0" if place == "glb" else "glTF 2.0")
    assert capture.error_bounds == {} and capture.notes == ()


def test_content_decides_and_the_suffix_where_there_is_none(tmp_path):
    """Oracle: the names of the formats."""
    assert formats.read(of_cloud(CLOUD).alone(tmp_path / "a.txt")).format == "glTF 2.0"
    assert formats.read(of_cloud(CLOUD).glb(tmp_path / "b")).format == "GLB 2.0"
    (tmp_path / "c.gltf").write_bytes(b"no document")
    with pytest.raises(FormatError, match="text that is not JSON"):
        formats.read(tmp_path / "c.gltf")
    with pytest.raises(UnknownFormatError):
        formats.write(CLOUD, tmp_path / "a.gltf")  # one file is what people want


@pytest.mark.parametrize("kind", ["i1", "i2"])
def test_whole_numbers_stand_for_fractions(tmp_path, kind):
    """Oracle: glTF's rule, code / largest, at least -1, by hand."""
    top = np.iinfo(kind).max
    sample = of_cloud(CLOUD)
    codes = np.array([[top, 0, 0, 0], [0, -top, 0, 0], [0, 0, -top - 1, 0]] * 3, kind)
    sample.add(f"{SPLATS}:ROTATION", codes, normalized=True)
    sample.add(f"{SPLATS}:OPACITY", np.array([[0], [255], [51]] * 3, "u1"), normalized=True)
    sample.add(f"{SPLATS}:SCALE", np.full((9, 3), 2, kind))
    capture = formats.read(sample.glb(tmp_path / "a.glb"))
    expected = [[0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1]] * 3  # w first
    np.testing.assert_array_equal(capture.cloud.rotations, np.float32(expected))
    np.testing.assert_array_equal(capture.cloud.opacities, np.float32([0, 1, 0.2] * 3))
    assert (capture.cloud.scales == 2).all()
    assert capture.error_bounds == {
        "rotations": f"1/{2 * top}",
        "opacities": "1/510",
        "scales": "1/2",
    }


def test_scales_below_zero_are_logarithms_of_older_drafts(tmp_path):
    """Oracle: the cloud, whose logarithms were stored."""
    sample = of_cloud(CLOUD)
    sample.add(f"{SPLATS}:SCALE", np.log(CLOUD.scales))
    capture = formats.read(sample.glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(capture.cloud.scales, CLOUD.scales, rtol=1e-6)
    assert any("logarithms" in note for note in capture.notes)


def test_opacities_beyond_their_range_are_clamped_and_told(tmp_path):
    """Oracle: 0 and 1, by hand."""
    sample = of_cloud(CLOUD)
    sample.add(f"{SPLATS}:OPACITY", np.float32([-1, 2, *[0.5] * 7])[:, None])
    capture = formats.read(sample.glb(tmp_path / "a.glb"))
    assert capture.cloud.opacities.tolist() == [0, 1, *[0.5] * 7]
    assert capture.notes == ("opacities outside 0 to 1, clamped: 2",)


def test_attributes_may_lie_between_each_other(tmp_path):
    """Oracle: the cloud; centres and scales are interleaved by hand."""
    sample = of_cloud(CLOUD)
    view = sample.view(np.hstack([CLOUD.positions, CLOUD.scales]).tobytes(), byteStride=24)
    for name, offset in (("POSITION", 0), (f"{SPLATS}:SCALE", 12)):
        accessor = sample.accessor_of(name)
        accessor["bufferView"], accessor["byteOffset"] = view, offset
    check_same(formats.read(sample.glb(tmp_path / "a.glb")).cloud, CLOUD)


def test_nodes_put_splats_where_they_stand(tmp_path):
    """Oracle: `edit`, with matrices multiplied out by hand."""
    sample = of_cloud(CLOUD)
    sample.root["scenes"] = [{"nodes": []}, {"nodes": [2, 0]}]
    sample.root["scene"] = 1
    half = np.sqrt(0.5)
    sample.root["nodes"] = [
        {"mesh": 0},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [1, 2, 3]},
        {"matrix": [*(0, 0, 2, 0), *(0, 2, 0, 0), *(-2, 0, 0, 0), *(5, 6, 7, 1)], "children": [1]},
    ]
    outer = np.array([[0, 0, -2, 5], [0, 2, 0, 6], [2, 0, 0, 7], [0, 0, 0, 1]])
    inner = np.array([[0, -2, 0, 0], [1, 0, 0, 0], [0, 0, 3, 0], [0, 0, 0, 1]])
    cloud = formats.read(sample.glb(tmp_path / "a.glb")).cloud
    expected = edit.merge([edit.transform(CLOUD, outer @ inner), CLOUD])
    np.testing.assert_allclose(cloud.positions, expected.positions, atol=1e-5)
    np.testing.assert_allclose(cloud.sh, expected.sh, atol=1e-5)
    np.testing.assert_allclose(_covariances(cloud), _covariances(expected), rtol=1e-3, atol=1e-6)


def test_a_lower_degree_beside_a_higher_one_is_padded(tmp_path):
    """Oracle: `edit.merge`."""
    sample = of_cloud(CLOUD)
    flat = copy.deepcopy(sample.primitive)
    flat["attributes"] = {
        name: index for name, index in flat["attributes"].items() if "SH_DEGREE_0" in name or
        "SH_" not in name
    }  # fmt: skip
    sample.root["meshes"][0]["primitives"].append(flat)
    cloud = formats.read(sample.glb(tmp_path / "a.glb")).cloud
    check_same(cloud, edit.merge([CLOUD, edit.with_sh_degree(CLOUD, 0)]))


def test_what_is_unknown_or_left_out_is_told(tmp_path):
    """Oracle: a person's expectation of the notes."""
    sample = of_cloud(CLOUD)
    sample.primitive["extensions"][SPLATS] = {"kernel": "cube", "colorSpace": "p3"}
    sample.root["meshes"][0]["primitives"].append({"attributes": {}})
    notes = formats.read(sample.glb(tmp_path / "a.glb")).notes
    assert notes == (
        "colour space 'p3' is unknown: srgb_rec709_display is assumed",
        "kernel 'cube' is unknown: an ellipse is assumed",
        "primitives without splats, left out: 1",
    )


def test_a_linear_colour_space_is_named_and_two_are_refused(tmp_path):
    """Oracle: USD's name of the same primaries and curve."""
    sample = of_cloud(CLOUD)
    sample.primitive["extensions"][SPLATS]["colorSpace"] = "lin_rec709_display"
    path = sample.glb(tmp_path / "a.glb")
    assert formats.read(path).color_space == "lin_rec709_scene"
    other = copy.deepcopy(sample.primitive)
    other["extensions"][SPLATS] = {}
    sample.root["meshes"][0]["primitives"].append(other)
    with pytest.raises(FormatError, match="splats in 2 colour spaces"):
        formats.read(sample.glb(path))


@pytest.mark.parametrize("stated", [False, True])
def test_an_spz_file_inside_is_turned_as_the_draft_says(tmp_path, stated):
    """Oracle: SPZ's own frame is "rub" and becomes "luf"; its file may say "rdf", index 6."""
    rng = np.random.default_rng(1)
    record = struct.pack("<III", 0xADBE0003, 4, 6) if stated else b""
    data = spz(rng.bytes(30 * 28) + record, count=30, version=2, degree=1, flags=2 * stated)
    (tmp_path / "a.spz").write_bytes(data)
    alone = formats.read(tmp_path / "a.spz")
    capture = formats.read(of_spz(data).glb(tmp_path / "a.glb"))
    turn = np.diag([-1, -1, 1, 1] if stated else [-1, 1, -1, 1])
    check_same(capture.cloud, edit.transform(alone.cloud, turn), atol=1e-6)
    assert capture.frame == "rub"
    assert capture.error_bounds == alone.error_bounds


def test_an_spz_file_that_claims_much_in_little_is_refused(tmp_path):
    """Oracle: half of what an SPZ file alone may claim."""
    sample = of_spz(spz(b"", count=1 << 20, degree=3))
    with pytest.raises(FormatError, match=f"found {1 << 20} splats in .*at most {1 << 19}"):
        formats.read(sample.glb(tmp_path / "a.glb"))


def test_splats_that_are_not_finite_are_named_or_dropped(tmp_path):
    """Oracle: the one that was spoilt, in a scene that moves it."""
    bad = CLOUD.sh.copy()
    bad[4, 5, 1] = np.nan
    sample = of_cloud(replace(CLOUD, sh=bad))
    sample.root["nodes"][0]["translation"] = [1, 0, 0]
    path = sample.glb(tmp_path / "a.glb")
    with pytest.raises(FormatError, match=r"SH_DEGREE_2_COEF_1 of splat 4: found nan"):
        formats.read(path)
    cloud = formats.read(path, how=formats.ReadOptions(drop_nonfinite=True)).cloud
    kept = np.delete(np.arange(9), 4)
    np.testing.assert_allclose(cloud.positions, CLOUD.positions[kept] + [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize(
    "uri",
    ["../a.bin", "/etc/passwd", "x/../../a.bin", "..%2Fa.bin", "file:///etc/passwd", "C:\\a.bin",
     "http://a/b", "a\0b", "", ".", "\ud800", "pipe", "missing.bin", "x" * 5000],
)  # fmt: skip
def test_buffers_stay_in_the_folder_and_are_plain_files(tmp_path, uri):
    """Oracle: what lies around the folder is none of the document's business."""
    folder = tmp_path / "in"
    folder.mkdir()
    os.mkfifo(folder / "pipe")
    (tmp_path / "a.bin").write_bytes(bytes(10_000))
    sample = of_cloud(CLOUD)
    sample.root["buffers"][0]["uri"] = uri
    (folder / "a.gltf").write_bytes(sample.text())
    with pytest.raises(FormatError, match=r"buffer 0.*found"):
        formats.read(folder / "a.gltf")


def test_a_buffer_may_lie_in_a_folder_below(tmp_path):
    """Oracle: the cloud; the reference is percent-encoded."""
    sample = of_cloud(CLOUD)
    (tmp_path / "my data").mkdir()
    (tmp_path / "my data" / "a.bin").write_bytes(sample.data)
    sample.root["buffers"][0]["uri"] = "my%20data/a.bin"
    (tmp_path / "a.gltf").write_bytes(sample.text())
    check_same(formats.read(tmp_path / "a.gltf").cloud, CLOUD)


def change(path, value):
    """A lie: sets what `path` leads to in the document."""

    def lie(sample):
        target = sample.root
        for key in path[:-1]:
            target = target[key]
        target[path[-1]] = value

    return lie


PRIMITIVE = ("meshes", 0, "primitives", 0)
LIES = {
    "version": (change(("asset", "version"), "1.0"), "asset.version: found '1.0'"),
    "no asset": (change(("asset",), None), "asset: found None"),
    "required": (change(("extensionsRequired",), ["EXT_x"]), "found 'EXT_x'"),
    "count": (change(("accessors", 0, "count"), 10**12), "found 1000000000000 elements"),
    "fewer": (change(("accessors", 1, "count"), 8), "found 8 elements, expected 9"),
    "negative count": (change(("accessors", 0, "count"), -1), "found -1"),
    "true as count": (change(("accessors", 0, "count"), True), "found True"),
    "component": (change(("accessors", 0, "componentType"), 5125), "found 5125"),
    "type": (change(("accessors", 0, "type"), "MAT4"), "found 'MAT4'"),
    "width": (change(("accessors", 0, "type"), "VEC2"), "2 numbers an element"),
    "sparse": (change(("accessors", 0, "sparse"), {}), "a sparse accessor"),
    "no view": (change(("accessors", 0, "bufferView"), None), "bufferView: found None"),
    "view": (change(("accessors", 0, "bufferView"), 99), "found 99"),
    "view of offset": (change(("bufferViews", 0, "byteOffset"), 1 << 40), "byteOffset: found"),
    "view of length": (change(("bufferViews", 0, "byteLength"), 1 << 40), "byteLength: found"),
    "stride": (change(("bufferViews", 0, "byteStride"), 4), "byteStride: found 4"),
    "buffer": (change(("buffers", 0, "byteLength"), 1 << 50), "as declared"),
    "no attribute": (change((*PRIMITIVE, "attributes", f"{SPLATS}:SCALE"), None), "found None"),
    "no splats": (change((*PRIMITIVE, "extensions"), {}), "found 1 primitives, none with"),
    "scene": (change(("scene",), 7), "scene: found 7"),
    "node": (change(("scenes", 0, "nodes"), [1]), "found 1"),
    "loop": (change(("nodes", 0, "children"), [0]), "a repeated node, or too many nodes"),
    "mesh": (change(("nodes", 0, "mesh"), "0"), "mesh: found '0'"),
    "matrix": (change(("nodes", 0, "matrix"), [1] * 16), "last row"),
    "short matrix": (change(("nodes", 0, "matrix"), [1] * 15), "15 values"),
    "far": (change(("nodes", 0, "translation"), [1e300, 0, 0]), "1e\\+300"),
    "text": (change((*PRIMITIVE, "extensions", SPLATS, "kernel"), 3), "kernel: found 3"),
    "lists": (change(("accessors",), {}), "accessors: found {}"),
    "uri": (change(("buffers", 0, "uri"), 3), "uri: found 3"),
    "data uri": (change(("buffers", 0, "uri"), "data:text,a"), "data URI"),
    "base64": (change(("buffers", 0, "uri"), "data:;base64,@@@@"), "damaged base64"),
    "escaped": (change(("buffers", 0, "uri"), 'data:"'), "a data URI"),
    "overflow": (change(("nodes", 0, "scale"), [1e15] * 3), None),
}


@pytest.mark.parametrize("name", LIES)
def test_documents_that_lie_are_refused_in_a_sentence(tmp_path, name):
    """Oracle: the shape of every error, and what it must name."""
    lie, found = LIES[name]
    sample = of_cloud(replace(CLOUD, positions=CLOUD.positions * np.float32(1e30)))
    lie(sample)
    path = sample.glb(tmp_path / "a.glb")
    with pytest.raises(FormatError, match=found) as caught:
        formats.read(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_harmonics_of_half_a_degree_are_refused(tmp_path):
    """Oracle: the extension allows whole degrees only."""
    sample = of_cloud(CLOUD)
    del sample.primitive["attributes"][f"{SPLATS}:SH_DEGREE_1_COEF_1"]
    with pytest.raises(FormatError, match=r"found no attribute .*SH_DEGREE_1_COEF_1"):
        formats.read(sample.glb(tmp_path / "a.glb"))


def test_a_scene_that_shows_one_mesh_too_often_is_refused(tmp_path):
    """Oracle: the limits; a kilobyte must not become gigabytes."""
    sample = of_cloud(CLOUD)
    sample.root["nodes"] = [{"mesh": 0}] * 2000
    sample.root["scenes"] = [{"nodes": list(range(2000))}]
    with pytest.raises(FormatError, match="found 1025 primitives, expected at most 1024"):
        formats.read(sample.glb(tmp_path / "a.glb"))
    many = of_spz(spz(bytes((1 << 16) * 19), count=1 << 16))
    many.root["nodes"] = [{"mesh": 0}] * 1000
    many.root["scenes"] = [{"nodes": list(range(1000))}]
    with pytest.raises(FormatError, match=f"found {1000 << 16} splats in"):
        formats.read(many.glb(tmp_path / "a.glb"))


def test_a_mesh_that_many_nodes_show_is_looked_at_once(tmp_path):
    """Oracle: 8000 nodes times 200 000 primitives, which would take hours one by one."""
    sample = of_cloud(CLOUD)
    sample.root["meshes"].append({"primitives": [{}] * 200_000})
    sample.root["nodes"] = [{"mesh": 0}] + [{"mesh": 1}] * 8_000
    sample.root["scenes"] = [{"nodes": list(range(8_001))}]
    capture = formats.read(sample.glb(tmp_path / "a.glb"))
    assert len(capture.cloud) == len(CLOUD)
    assert "primitives without splats, left out: 1600000000" in capture.notes


def test_long_json_and_deep_json_are_refused(tmp_path):
    """Oracle: the limit, which data URIs do not count for."""
    path = tmp_path / "a.gltf"
    path.write_bytes(b'{"asset":{"version":"2.0"},"extras":"' + b"x" * (1 << 23) + b'"}')
    with pytest.raises(FormatError, match=r"bytes of JSON, expected at most 4194304"):
        formats.read(path)
    path.write_bytes(b'{"asset":{"version":"2.0"},"extras":' + b"[" * 100_000)
    with pytest.raises(FormatError, match="text that is not JSON"):
        formats.read(path)
    sample = of_cloud(CLOUD)
    sample.data += bytes(document._TEXT_LIMIT)
    check_same(formats.read(sample.alone(path)).cloud, CLOUD)


def _covariances(cloud):
    turns = quaternion.to_matrix(cloud.rotations.astype(np.float64)) * cloud.scales[:, None]
    return turns @ turns.transpose(0, 2, 1)


def test_what_is_no_spz_file_is_refused_as_that(tmp_path):
    """Oracle: the sentence names the primitive."""
    with pytest.raises(FormatError, match="mesh 0, primitive 0: found b'oops' at the start"):
        formats.read(of_spz(b"oops").glb(tmp_path / "a.glb"))
