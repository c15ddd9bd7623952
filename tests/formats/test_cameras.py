"""Tests of the cameras of photographs."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from tests.formats.camera_files import (
    LENSES,
    SHOTS,
    colmap_binary,
    colmap_text,
    nerf_pose,
    transforms,
)
from usdsplat.core.errors import FormatError
from usdsplat.formats import cameras
from usdsplat.formats.cameras.lens import lens
from usdsplat.formats.cameras.posed import carried

PLAIN = {"w": 640, "h": 480, "fl_x": 500.0, "fl_y": 510.0, "cx": 300.0, "cy": 260.0}
POINTS = np.random.default_rng(0).normal(size=(20, 3))


def assert_sees(posed, shot, to_capture=None):
    """A camera has points where the photograph has them; `to_capture` (4, 4) took them along."""
    points = np.column_stack([POINTS, np.ones(len(POINTS))])
    there = points if to_capture is None else points @ to_capture.T
    found = (there @ np.linalg.inv(posed.to_capture).T)[:, :3]
    expected = shot.seen(POINTS)
    scale = 1 if to_capture is None else np.cbrt(np.linalg.det(to_capture[:3, :3]))
    np.testing.assert_allclose(found, scale * expected, atol=1e-9)


@pytest.mark.parametrize("write", [colmap_text, colmap_binary])
@pytest.mark.parametrize("where", ["", "sparse/0", "colmap/sparse/0"])
def test_a_model_of_colmap_is_read_wherever_a_data_set_has_it(tmp_path, write, where):
    """Oracle: the poses that were written, by COLMAP's definition of them."""
    write(tmp_path / where)
    found = cameras.read(tmp_path)
    assert found.format == ("COLMAP text" if write is colmap_text else "COLMAP binary")
    assert [camera.name for camera in found.cameras] == [shot.name for shot in SHOTS]
    for posed, shot in zip(found.cameras, SHOTS, strict=True):
        assert_sees(posed, shot)
        model, width, height, parameters = LENSES[shot.camera]
        taken = posed.lens
        assert (taken.model, taken.width, taken.height) == (model, width, height)
        assert (taken.fx, taken.fy, taken.cx, taken.cy) == parameters[:4]
    assert found.cameras[0].lens.is_pinhole
    coefficients = dict(zip(("k1", "k2", "p1", "p2"), LENSES[7][3][4:], strict=True))
    assert found.cameras[1].lens.distortion == coefficients


def test_one_file_of_a_model_names_the_others_of_its_kind(tmp_path):
    """Oracle: a folder with both kinds, of which COLMAP itself takes the binary one."""
    colmap_text(tmp_path)
    colmap_binary(tmp_path)
    assert cameras.read(tmp_path).format == "COLMAP binary"
    assert cameras.read(tmp_path / "images.txt").format == "COLMAP text"
    assert cameras.read(tmp_path / "cameras.bin").format == "COLMAP binary"


def test_lists_of_points_may_be_of_any_length(tmp_path):
    """Oracle: 20,000 points are a line of a quarter of a megabyte, of which nothing is wanted."""
    shots = [replace(shot, points=20_000) for shot in SHOTS]
    assert len(cameras.read(colmap_text(tmp_path / "t", shots)).cameras) == 2
    assert len(cameras.read(colmap_binary(tmp_path / "b", shots)).cameras) == 2


def test_transforms_have_y_up_and_intrinsics_of_their_own(tmp_path):
    """Oracle: NeRF's definition of the pose; a frame's numbers are stronger than the file's."""
    frames = [
        {"file_path": "./images/a.png", "transform_matrix": nerf_pose(SHOTS[0])},
        {"file_path": "b.png", "transform_matrix": nerf_pose(SHOTS[1]), "fl_x": 900.0, "k1": 0.2},
    ]
    found = cameras.read(transforms(tmp_path / "transforms.json", frames, **PLAIN))
    assert (found.format, found.notes) == ("transforms.json", ())
    for posed, shot in zip(found.cameras, SHOTS, strict=True):
        assert_sees(posed, shot)
    first, second = (camera.lens for camera in found.cameras)
    assert [camera.name for camera in found.cameras] == ["images/a.png", "b.png"]
    assert (first.fx, first.fy, first.cx, first.cy) == (500, 510, 300, 260)
    assert (first.model, second.model) == ("PINHOLE", "OPENCV")
    assert (second.fx, second.distortion) == (900, {"k1": 0.2})


def test_an_angle_of_view_and_a_picture_are_enough(tmp_path):
    """Oracle: a right angle across 80 pixels is a focal length of 40; Pillow wrote the picture."""
    from PIL import Image

    (tmp_path / "train").mkdir()
    Image.new("RGB", (80, 60)).save(tmp_path / "train" / "r_0.png")
    frames = [{"file_path": "./train/r_0", "transform_matrix": np.eye(4).tolist()}]
    path = transforms(tmp_path / "transforms_train.json", frames, camera_angle_x=math.pi / 2)
    (camera,) = cameras.read(path).cameras
    taken = camera.lens
    assert (taken.width, taken.height, taken.cx, taken.cy) == (80, 60, 40, 30)
    assert taken.fx == taken.fy == pytest.approx(40)


@pytest.mark.parametrize("told", [True, False])
def test_cameras_go_where_nerfstudio_took_the_world(tmp_path, told):
    """Oracle: nerfstudio's documentation: the file's world is the applied transform's, and
    training begins again at COLMAP's; points go the same way by the same definition."""
    applied = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0.0], [0, 0, 0, 1]])
    angle = 0.4
    trained = np.eye(4)
    trained[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    trained[:3, 3] = 1, 2, 3
    frames = [{"file_path": "a.png", "transform_matrix": nerf_pose(SHOTS[0], applied)}]
    top = {**PLAIN, "applied_transform": applied[:3].tolist()} if told else PLAIN
    path = transforms(tmp_path / "transforms.json", frames, **top)
    if not told:  # as it was before nerfstudio wrote it down
        (tmp_path / "colmap/sparse/0").mkdir(parents=True)
    beside = {"transform": trained[:3].tolist(), "scale": 0.25}
    (tmp_path / "dataparser_transforms.json").write_text(json.dumps(beside))
    found = cameras.read(path)
    assert_sees(found.cameras[0], SHOTS[0], np.diag([0.25, 0.25, 0.25, 1]) @ trained)
    assert "dataparser_transforms.json" in found.notes[0] and len(found.files) == 2


def test_a_world_that_was_turned_without_a_trace_is_noted(tmp_path):
    """Oracle: there is nothing that says how the capture lies, so the file's own world is left."""
    frames = [{"file_path": "a.png", "transform_matrix": nerf_pose(SHOTS[0])}]
    top = {**PLAIN, "applied_transform": np.eye(4)[:3].tolist()}
    found = cameras.read(transforms(tmp_path / "transforms.json", frames, **top))
    assert_sees(found.cameras[0], SHOTS[0])
    assert "applied_transform" in found.notes[0]


def test_a_carried_camera_keeps_its_picture():
    """Oracle: the ratios of camera coordinates, which are what a picture is made of."""
    shot = SHOTS[0]
    pose = np.linalg.inv(np.vstack([np.column_stack([shot.rotation, shot.shift]), [0, 0, 0, 1]]))
    similarity = np.eye(4)
    similarity[:3, :3] = 3 * SHOTS[1].rotation
    similarity[:3, 3] = 4, 5, 6
    moved = carried(pose, similarity)
    np.testing.assert_allclose(moved[:3, :3] @ moved[:3, :3].T, np.eye(3), atol=1e-12)
    seen = (POINTS @ similarity[:3, :3].T + similarity[:3, 3] - moved[:3, 3]) @ moved[:3, :3]
    np.testing.assert_allclose(seen, 3 * shot.seen(POINTS), atol=1e-12)
    for wrong in (np.diag([-1.0, 1, 1, 1]), np.diag([1.0, 2, 1, 1])):
        with pytest.raises(ValueError, match="similarity"):
            carried(pose, wrong)


def test_a_lens_says_how_far_it_bends_the_picture():
    """Oracle: OpenCV's polynomials by hand, at a corner 1 and 1 from the axis: r^2 = 2."""
    size, pinhole = (200, 200), [100.0, 100.0, 100.0, 100.0]
    assert lens("a", "PINHOLE", size, pinhole).displacement == 0
    radial = lens("a", "OPENCV", size, [*pinhole, 0.1, 0, 0, 0])
    assert radial.displacement == pytest.approx(100 * math.sqrt(2) * 0.1 * 2)
    fisheye = lens("a", "OPENCV_FISHEYE", size, [*pinhole, 0, 0, 0, 0])
    assert not fisheye.is_pinhole
    corner = math.sqrt(2) - math.atan(math.sqrt(2))
    assert fisheye.displacement == pytest.approx(100 * corner)
    assert lens("a", "FOV", size, [*pinhole, 0.9]).displacement is None


def bad_text(folder, name, old, new):
    """A model in text with a part of one file replaced."""
    colmap_text(folder)
    path = folder / f"{name}.txt"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("cameras", "PINHOLE", "CRYSTAL_BALL", "camera model 'CRYSTAL_BALL'"),
        ("cameras", "500.0 ", "", "3 parameters of PINHOLE, expected 4"),
        ("cameras", "500.0", "-500.0", "fx: found -500, expected a positive"),
        ("cameras", "500.0", "inf", "fx: found inf, expected a positive"),
        ("cameras", "300.0", "nan", "cx: found nan"),
        ("cameras", "640", "99999999999", "a picture of 99999999999 x 480"),
        ("cameras", "640", "6e2", "'6e2', expected a whole number"),
        ("images", "0.9 0.1 -0.3 0.2", "0 0 0 0", "a quaternion and a translation"),
        ("images", "4.0", "nan", "a quaternion and a translation"),
        ("images", " 7 a", " 8 a", "camera 8, expected one of cameras.txt"),
        ("images", "4.0 1 left/0001.jpg", "4.0", "8 words, expected IMAGE_ID"),
        ("images", "left/0001.jpg", "x" * 9000, "a line of more than 8192 bytes"),
    ],
)
def test_text_that_lies_is_refused_in_a_sentence(tmp_path, name, old, new, said):
    """Oracle: a person's expectation; the sentence names the file and what is wrong."""
    bad_text(tmp_path, name, old, new)
    with pytest.raises(FormatError) as error:
        cameras.read(tmp_path)
    assert said in str(error.value) and f"{name}.txt" in str(error.value)


@pytest.mark.parametrize(
    ("name", "at", "new", "said"),
    [
        ("cameras", 0, struct.pack("<Q", 1 << 60), "cameras, expected 1 to"),
        ("images", 0, struct.pack("<Q", 1 << 60), "cameras, expected 1 to"),
        ("images", 0, struct.pack("<Q", 3), "a truncated file"),
        ("images", 0, struct.pack("<Q", 0), "0 cameras"),
        ("cameras", 12, struct.pack("<i", 99), "camera model 'number 99'"),
        ("images", 8 + 64 + 14, struct.pack("<Q", 1 << 61), "points, expected as many as"),
        ("images", 8 + 64, b"x" * 200, "an unterminated name"),
    ],
)
def test_binary_that_lies_is_refused_in_a_sentence(tmp_path, name, at, new, said):
    """Oracle: a person's expectation; nothing is taken on the word of a count."""
    colmap_binary(tmp_path)
    path = tmp_path / f"{name}.bin"
    data = bytearray(path.read_bytes())
    data[at : at + len(new)] = new
    path.write_bytes(bytes(data) if at < 70 or len(new) < 99 else bytes(data[: at + len(new)]))
    with pytest.raises(FormatError) as error:
        cameras.read(tmp_path)
    assert said in str(error.value)


@pytest.mark.parametrize("write", [colmap_text, colmap_binary])
def test_no_byte_that_is_cut_off_or_wrong_raises_anything_else(tmp_path, write):
    """Oracle: none; whatever is made of a file, it is cameras or one sentence."""
    rng = np.random.default_rng(1)
    folder = write(tmp_path)
    whole = {path: path.read_bytes() for path in sorted(folder.iterdir())}
    refused = 0
    for round_ in range(150):
        for path, data in whole.items():
            hurt = bytearray(data)
            for place in rng.integers(0, len(hurt), 1 + round_ % 4):
                hurt[place] = rng.integers(0, 256)
            path.write_bytes(bytes(hurt[: rng.integers(1, len(hurt))] if round_ % 3 == 0 else hurt))
        try:
            found = cameras.read(folder)
        except FormatError:
            refused += 1
        else:
            assert all(np.isfinite(camera.to_capture).all() for camera in found.cameras)
    assert refused > 50


@pytest.mark.parametrize(
    ("frame", "top", "said"),
    [
        ({}, {}, "transform_matrix"),
        ({"transform_matrix": [[1, 0, 0, 0]] * 3}, {}, "a matrix that mirrors or shears"),
        ({"transform_matrix": np.diag([-1.0, 1, 1, 1]).tolist()}, {}, "mirrors or shears"),
        ({"transform_matrix": [[1, 0, 0, 1e400]] * 3}, {}, "a finite number"),
        ({"transform_matrix": "eye"}, {}, "3 or 4 rows of 4 numbers"),
        (None, {"w": True}, "w: found True"),
        (None, {"fl_x": 0}, "fx: found 0"),
        (None, {"camera_model": "EQUIRECTANGULAR"}, "camera_model"),
        (None, {"w": 1e11}, "a picture of"),
    ],
)
def test_transforms_that_lie_are_refused_in_a_sentence(tmp_path, frame, top, said):
    """Oracle: a person's expectation."""
    good = {"file_path": "a.png", "transform_matrix": nerf_pose(SHOTS[0])}
    path = transforms(tmp_path / "transforms.json", [good if frame is None else frame], **PLAIN)
    value = json.loads(path.read_text())
    path.write_text(json.dumps({**value, **top}))
    with pytest.raises(FormatError) as error:
        cameras.read(path)
    assert said in str(error.value)


@pytest.mark.parametrize("text", [b"", b"[1]", b"{", b"[" * 100_000, b'{"frames": []}', b"\xff"])
def test_what_is_no_list_of_frames_is_refused(tmp_path, text):
    """Oracle: a person's expectation."""
    path = tmp_path / "transforms.json"
    path.write_bytes(text)
    with pytest.raises(FormatError, match=r"transforms\.json"):
        cameras.read(path)


def test_without_a_size_a_picture_must_be_there(tmp_path):
    """Oracle: a person's expectation; names that no file can have are among those without one."""
    for name in ("a.png", "x" * 5000, "a\0b", "/", ".."):
        frames = [{"file_path": name, "transform_matrix": np.eye(4).tolist()}]
        path = transforms(tmp_path / "transforms.json", frames, camera_angle_x=1.0)
        with pytest.raises(FormatError, match=r"no w and h|w and h, or a picture"):
            cameras.read(path)


def test_where_there_is_nothing_it_says_what_is_looked_for(tmp_path):
    """Oracle: a person's expectation."""
    (tmp_path / "images.txt").write_text("")
    for path in (tmp_path, tmp_path / "none", tmp_path / "images.txt", tmp_path / "none.json"):
        with pytest.raises(FormatError) as error:
            cameras.read(path)
        assert str(path) in str(error.value)
