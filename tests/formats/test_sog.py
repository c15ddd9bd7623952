"""Tests of SOG: files made from chosen pixels, decoded one number at a time."""

from __future__ import annotations

import io
import json
import math
import zipfile

import numpy as np
import pytest

from tests.formats.samples import declared_webp, sog_files, webp, with_meta, zipped
from usdsplat import formats
from usdsplat.core.errors import FormatError


def pixel(files, name, index):
    """RGBA of a pixel, as Pillow decodes it."""
    from PIL import Image

    image = Image.open(io.BytesIO(files[f"{name}.webp"])).convert("RGBA")
    return image.getpixel((index % image.width, index // image.width))


def rotation(code):
    """Quaternion of a pixel of `quats`, by formats.md 2.5."""
    small = [(c / 255 * 2 - 1) / math.sqrt(2) for c in code[:3]]
    whole = list(small)
    whole.insert(code[3] - 252, math.sqrt(max(0, 1 - sum(v * v for v in small))))
    length = math.sqrt(sum(v * v for v in whole))
    return [v / length for v in whole]


def position(meta, low, high):
    """Position of pixels of `means_l` and `means_u`."""
    out = []
    for axis in range(3):
        t = (low[axis] | high[axis] << 8) / 65535
        least, most = meta["means"]["mins"][axis], meta["means"]["maxs"][axis]
        value = least + (most - least) * t
        out.append(math.copysign(math.exp(abs(value)) - 1, value))
    return out


def as_version_1(files):
    """The same images with ranges where version 2 has tables."""
    meta = json.loads(files["meta.json"])
    means = {**meta["means"], "shape": [meta["count"], 3], "dtype": "uint16"}
    scales = {"files": meta["scales"]["files"], "mins": [-9, -8, -7], "maxs": [-1, -2, -3]}
    sh0 = {"files": meta["sh0"]["files"], "mins": [-1, -2, -3, -6], "maxs": [1, 2, 3, 6]}
    rest = {"files": meta["shN"]["files"], "mins": -0.5, "maxs": 0.25, "quantization": 8}
    changes = {"means": means, "scales": scales, "sh0": sh0, "shN": rest}
    return with_meta(files, version=None, count=None, **changes)


@pytest.mark.parametrize("bands", [1, 2, 3, 4])
def test_version_2_decodes_as_the_layout_says(tmp_path, bands):
    """Oracle: the layout of formats.md 2.5 in Python's own numbers, pixel by pixel."""
    files = sog_files(bands=bands)
    meta = json.loads(files["meta.json"])
    capture = formats.read(zipped(tmp_path / "a.sog", files))
    cloud = capture.cloud
    assert (len(cloud), cloud.sh_degree, capture.format) == (14, bands, "SOG 2")
    per_channel = (bands + 1) ** 2 - 1
    for row in range(14):
        code = {name: pixel(files, name, row) for name in ("means_l", "means_u", "scales", "quats")}
        color, label = pixel(files, "sh0", row), pixel(files, "shN_labels", row)[0]
        place = position(meta, code["means_l"], code["means_u"])
        np.testing.assert_allclose(cloud.positions[row], place, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(cloud.rotations[row], rotation(code["quats"]), atol=1e-6)
        sizes = [math.exp(meta["scales"]["codebook"][c]) for c in code["scales"][:3]]
        np.testing.assert_allclose(cloud.scales[row], sizes, rtol=1e-6)
        sh = [[meta["sh0"]["codebook"][c] for c in color[:3]]]
        for k in range(per_channel):
            entry = pixel(files, "shN_centroids", label * per_channel + k)
            sh.append([meta["shN"]["codebook"][c] for c in entry[:3]])
        np.testing.assert_allclose(cloud.sh[row], sh, atol=1e-6)
        np.testing.assert_allclose(cloud.opacities[row], color[3] / 255, atol=1e-7)


@pytest.mark.parametrize("bands", [1, 2, 3])
def test_version_1_decodes_as_the_layout_says(tmp_path, bands):
    """Oracle: formats.md 2.5, version 1: linear ranges, a logit for opacity, bands by width."""
    files = as_version_1(sog_files(bands=bands))
    meta = json.loads(files["meta.json"])
    capture = formats.read(zipped(tmp_path / "a.sog", files))
    cloud = capture.cloud
    assert (len(cloud), cloud.sh_degree, capture.format) == (14, bands, "SOG 1")

    def lerp(section, channel, code):
        least, most = meta[section]["mins"][channel], meta[section]["maxs"][channel]
        return least + (most - least) * code / 255

    for row in range(14):
        size, color = pixel(files, "scales", row), pixel(files, "sh0", row)
        sizes = [math.exp(lerp("scales", c, size[c])) for c in range(3)]
        np.testing.assert_allclose(cloud.scales[row], sizes, rtol=1e-6)
        np.testing.assert_allclose(
            cloud.sh[row, 0], [lerp("sh0", c, color[c]) for c in range(3)], atol=1e-6
        )
        logit = lerp("sh0", 3, color[3])
        np.testing.assert_allclose(cloud.opacities[row], 1 / (1 + math.exp(-logit)), rtol=1e-6)
        label = pixel(files, "shN_labels", row)[0]
        entry = pixel(files, "shN_centroids", label * ((bands + 1) ** 2 - 1))
        rest = [-0.5 + 0.75 * c / 255 for c in entry[:3]]
        np.testing.assert_allclose(cloud.sh[row, 1], rest, atol=1e-6)


def test_a_bad_rotation_tag_is_the_identity(tmp_path):
    """Oracle: formats.md 2.5."""
    files = sog_files()
    codes = np.full((4, 4, 4), 7)
    codes[..., 3] = 251
    cloud = formats.read(zipped(tmp_path / "a.sog", {**files, "quats.webp": webp(codes)})).cloud
    assert cloud.rotations.tolist() == [[1, 0, 0, 0]] * 14


def test_rotations_are_units_whatever_their_codes(tmp_path):
    """Oracle: the length; three components of which each may be sqrt(1/2) are longer than 1."""
    rng = np.random.default_rng(0)
    codes = rng.choice([0, 1, 128, 254, 255], (4, 4, 4))
    codes[..., 3] = rng.integers(252, 256, (4, 4))
    cloud = formats.read(
        zipped(tmp_path / "a.sog", {**sog_files(), "quats.webp": webp(codes)})
    ).cloud
    np.testing.assert_allclose(np.linalg.norm(cloud.rotations, axis=1), 1, rtol=1e-6)


def test_splats_that_are_not_finite_are_dropped_if_asked(tmp_path):
    """Oracle: the codes whose entry is infinite, by Pillow's own reading."""
    files = sog_files()
    meta = json.loads(files["meta.json"])
    meta["scales"]["codebook"][128:] = [900.0] * 128
    path = zipped(tmp_path / "a.sog", with_meta(files, scales=meta["scales"]))
    whole = [row for row in range(14) if max(pixel(files, "scales", row)[:3]) < 128]
    capture = formats.read(path, how=formats.ReadOptions(drop_nonfinite=True))
    expected = formats.read(zipped(tmp_path / "b.sog", files)).cloud.positions[whole]
    np.testing.assert_array_equal(capture.cloud.positions, expected)
    assert f"they contain a number that is not finite: {14 - len(whole)}" in capture.notes[-1]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, False),
        ({"antialias": True}, True),
        ({"model": "antialiased"}, True),
        ({"model": "2dgs"}, False),
    ],
)
def test_the_projection_is_told_by_either_word(tmp_path, changes, expected):
    """Oracle: `antialias` of the format's document, `model` of splat-transform 3."""
    path = zipped(tmp_path / "a.sog", with_meta(sog_files(), **changes))
    assert formats.read(path).antialiased is expected


def test_harmonics_are_optional_and_deflated_entries_are_read(tmp_path):
    """Oracle: the same cloud without its bands; zip's other usual method."""
    plain = formats.read(zipped(tmp_path / "a.sog", sog_files())).cloud
    files = with_meta(sog_files(), shN=None)
    path = zipped(tmp_path / "b.sog", files, method=zipfile.ZIP_DEFLATED)
    cloud = formats.read(path).cloud
    assert cloud.sh_degree == 0
    np.testing.assert_array_equal(cloud.sh, plain.sh[:, :1])


def test_a_folder_and_its_meta_are_read(tmp_path):
    """Oracle: the archive of the same files."""
    files = sog_files()
    archive = formats.read(zipped(tmp_path / "a.sog", files)).cloud
    (tmp_path / "scan").mkdir()
    for name, data in files.items():
        (tmp_path / "scan" / name).write_bytes(data)
    for path in (tmp_path / "scan", tmp_path / "scan" / "meta.json"):
        np.testing.assert_array_equal(formats.read(path).cloud.sh, archive.sh)


def changed(section, key, value):
    """A change of one value of a section; None removes it."""

    def change(files):
        meta = json.loads(files["meta.json"])
        meta[section][key] = value
        if value is None:
            del meta[section][key]
        return with_meta(files, **{section: meta[section]})

    return change


def replaced(name, data):
    return lambda files: {**files, name: data}


def top(**changes):
    return lambda files: with_meta(files, **changes)


SMALL = webp(np.zeros((3, 4, 4)))
WIDE = webp(np.zeros((1, 65, 4)))
HIGH_LABELS = webp(np.full((4, 4, 4), 1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (replaced("meta.json", b"{"), "text that is not JSON"),
        (replaced("meta.json", b"\xff\xfe"), "text that is not JSON"),
        (replaced("meta.json", b"[" * 100_000), "text that is not JSON"),
        (replaced("meta.json", b"[1]"), "expected a JSON object"),
        (replaced("meta.json", b" " * 2_000_000), "meta.json: found over 1048576 bytes"),
        (top(version=3), "version: found 3"),
        (top(version="2"), "version: found '2'"),
        (top(count=-1), "count: found -1"),
        (top(count=14.0), "count: found 14.0"),
        (top(count=True), "count: found True"),
        (top(count=10**4000), "count: found 1000"),
        (top(count=17), "4 x 4 pixels, expected room for 17"),
        (top(count=10**9), "1000000000 splats in"),
        (top(means=None), "means: found None"),
        (top(quats=[1]), r"quats: found \[1\]"),
        (changed("means", "mins", [0, 0]), "means.mins: found 2 values"),
        (changed("means", "mins", 5), "means.mins: found 5"),
        (changed("means", "maxs", [0, math.nan, 0]), "means.maxs: found nan"),
        (changed("means", "maxs", [0, 10**500, 0]), "means.maxs: found 1000"),
        (changed("means", "maxs", [0, "1", 0]), "means.maxs: found '1'"),
        (changed("means", "maxs", [0, 300, 0]), "positions of splat .*: found inf"),
        (changed("scales", "codebook", [0] * 255), "scales.codebook: found 255 values"),
        (changed("scales", "codebook", [900] * 256), "scales of splat 0: found inf"),
        (changed("sh0", "codebook", None), "sh0.codebook: found None"),
        (changed("sh0", "codebook", [1e60] * 256), "sh of splat 0: found inf"),
        (changed("shN", "codebook", [-1e60] * 256), "sh of splat 0: found -inf"),
        (changed("shN", "bands", 2), "192 x 1 pixels, expected a width of 64"),
        (changed("shN", "bands", 0), "shN.bands: found 0"),
        (changed("quats", "files", ["quats.webp", "b"]), "an object with 1 file names"),
        (changed("quats", "files", [7]), "an object with 1 file names"),
        (changed("quats", "files", ["../quats.webp"]), r"file name '../quats.webp'"),
        (changed("quats", "files", ["/etc/hosts"]), "file name '/etc/hosts'"),
        (changed("quats", "files", ["a\\b"]), "without folders"),
        (changed("quats", "files", ["c:quats.webp"]), "without folders"),
        (changed("quats", "files", [".."]), "without folders"),
        (changed("quats", "files", ["none.webp"]), "found 0 entries 'none.webp'"),
        (replaced("quats.webp", SMALL), "4 x 3 pixels, expected room for 14"),
        (replaced("quats.webp", declared_webp(16384, 16384)), "16384 x 16384 pixels"),
        (replaced("quats.webp", declared_webp(4, 4)), "damaged WebP data"),
        (replaced("quats.webp", b"\x89PNG\r\n"), "expected a WebP image"),
        (replaced("quats.webp", bytes(1_000_000)), "quats.webp: found over"),
        (replaced("shN_centroids.webp", WIDE), "65 x 1 pixels"),
        (replaced("shN_labels.webp", HIGH_LABELS), "palette entry 257 of splat 0"),
    ],
)
def test_a_sog_that_lies_is_refused(tmp_path, change, message):
    """Oracle: what is wrong with it."""
    with pytest.raises(FormatError, match=message) as caught:
        formats.read(zipped(tmp_path / "a.sog", change(sog_files())))
    assert len(str(caught.value)) < 400


def test_a_folder_that_lacks_an_image_is_refused(tmp_path):
    """Oracle: the file that was not written."""
    files = sog_files()
    for name in files.keys() - {"sh0.webp"}:
        (tmp_path / name).write_bytes(files[name])
    with pytest.raises(FormatError, match=r"no file 'sh0.webp'"):
        formats.read(tmp_path)


@pytest.mark.parametrize("name", ["q" * 300, "\ud800", "a\n"])
def test_names_that_no_disk_has_are_refused(tmp_path, name):
    """Oracle: the operating system's own limits."""
    for file, data in changed("quats", "files", [name])(sog_files()).items():
        (tmp_path / file).write_bytes(data)
    with pytest.raises(FormatError, match="found no file") as caught:
        formats.read(tmp_path)
    assert len(str(caught.value).encode().splitlines()) == 1


def test_archives_that_are_odd_are_refused(tmp_path):
    """Oracle: what zipfile itself would do with them."""
    files = sog_files()
    good = zipped(tmp_path / "good.sog", files).read_bytes()
    odd = {
        "cut.sog": (good[:-30], "a damaged archive"),
        "text.sog": (b"PK\x03\x04 but no more", "a damaged archive"),
    }
    bzip = zipped(tmp_path / "bzip.sog", files, method=zipfile.ZIP_BZIP2).read_bytes()
    odd["bzip.sog"] = (bzip, "an entry that is encrypted, or compressed by another method")
    at = good.index(files["scales.webp"][:40])
    spoilt = good[:at] + bytes(40) + good[at + 40 :]
    odd["spoilt.sog"] = (spoilt, "a damaged archive .*CRC")
    offset = int.from_bytes(good[-6:-2], "little") + 1_000_000
    odd["before_the_start.sog"] = (
        good[:-6] + offset.to_bytes(4, "little") + good[-2:],
        "a damaged archive",
    )
    for name, (data, message) in odd.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(FormatError, match=message):
            formats.read(tmp_path / name)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_archive_with_a_name_twice_is_refused(tmp_path):
    """Oracle: which of the two is meant cannot be known."""
    path = zipped(tmp_path / "twice.sog", sog_files())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("quats.webp", SMALL)
    with pytest.raises(FormatError, match=r"2 entries 'quats.webp', expected one"):
        formats.read(path)


def test_a_zip_without_meta_is_no_sog(tmp_path):
    """Oracle: an archive of something else."""
    with pytest.raises(FormatError, match=r"found 0 entries 'meta.json'"):
        formats.read(zipped(tmp_path / "a.zip", {"a.txt": b"1"}))
