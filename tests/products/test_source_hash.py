"""Tests of the hash of the files that a picture is made from."""

from __future__ import annotations

import hashlib

from pxr import Sdf, Usd

from usdsplat.delegate.engine import Engine
from usdsplat.products.source_hash import source_hash


def test_contents_count_and_names_of_layers_do_not(tmp_path):
    """Oracle: hashlib, of the digests of the contents in order."""
    files = [tmp_path / "a", tmp_path / "b"]
    for file in files:
        file.write_bytes(file.name.encode())
    digests = sorted(hashlib.sha256(each).hexdigest() for each in (b"a", b"b"))
    expected = hashlib.sha256("".join(digests).encode()).hexdigest()
    assert source_hash([str(file) for file in files]) == expected
    copy = tmp_path / "c"
    copy.write_bytes(b"a")
    assert source_hash([str(files[1]), str(copy)]) == expected
    assert source_hash([str(tmp_path / "none")]) == source_hash([]) == ""


def test_value_clips_count_whatever_frame_is_open(tmp_path):
    """Oracle: the same stage at two frames has one hash; a clip of another size has another."""

    for number in (1, 2):
        clip = Usd.Stage.CreateNew(str(tmp_path / f"a.{number}.usda"))
        clip.DefinePrim("/A").CreateAttribute("x", Sdf.ValueTypeNames.Float).Set(1.0, 0)
        clip.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    prim = stage.DefinePrim("/A")
    clips = Usd.ClipsAPI(prim)
    clips.SetClipAssetPaths([Sdf.AssetPath(f"./a.{number}.usda") for number in (1, 2)])
    clips.SetClipPrimPath("/A")
    clips.SetClipActive([(1, 0), (2, 1)])
    clips.SetClipTimes([(1, 0), (2, 0)])
    stage.Save()

    def hashed(frame: float) -> str:
        opened = Usd.Stage.Open(str(tmp_path / "shot.usda"))
        opened.GetPrimAtPath("/A").GetAttribute("x").Get(frame)
        with Engine(opened, device="cpu", time=frame) as engine:
            info = engine.stage_info()
        assert [path.rpartition("/")[2] for path in info.clips] == ["a.1.usda", "a.2.usda"]
        return source_hash(info.files, info.clips)

    before = hashed(1)
    assert before and hashed(2) == before
    with (tmp_path / "a.2.usda").open("a") as file:
        file.write("# longer\n")
    assert hashed(1) != before
