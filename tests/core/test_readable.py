"""Tests of names for C++ libraries."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from pxr import Sdf, Tf

from usdsplat.core.errors import StageError
from usdsplat.core.readable import check_referable, original, readable

pytestmark = pytest.mark.wrong_stages  # they hold a few bytes that are no layer

STRANGE = os.fsdecode(b"bad\xff.usda")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a file whose name is not UTF-8, and one with a plain name."""
    try:
        (tmp_path / STRANGE).write_bytes(b"strange")
    except OSError:
        pytest.skip("the file system takes UTF-8 only")
    (tmp_path / "plain.usda").write_bytes(b"plain")
    return tmp_path


def test_a_name_in_utf_8_stays(folder: Path) -> None:
    """Oracle: the very name."""
    assert readable(folder / "plain.usda") == str(folder / "plain.usda")
    check_referable(folder / "plain.usda")


def test_another_name_is_a_link_with_its_neighbours_beside_it(folder: Path) -> None:
    """Oracle: the bytes of both files, read by names that UTF-8 can encode."""
    name = readable(folder / STRANGE)
    name.encode("utf-8")
    assert Path(name).read_bytes() == b"strange"
    assert Path(name).with_name("plain.usda").read_bytes() == b"plain"
    assert Path(name).name == "bad_xff.usda"
    assert readable(folder / STRANGE) == name
    with pytest.raises(StageError, match=r"bad.xff\.usda: found a name that is not UTF-8"):
        check_referable(name)


@pytest.mark.parametrize("character", ["\n", "\x7f", "\x85"])
def test_a_name_with_a_control_character_cannot_be_referred_to(character: str) -> None:
    """Oracle: the asset paths that USD accepts; a folder above both is not in a relative path."""
    with pytest.raises(Tf.ErrorException):
        Sdf.AssetPath(f"./a{character}.usda")
    with pytest.raises(StageError, match=r"^/b/a\\.*\.usda: found a name with a control character"):
        check_referable(f"/b/a{character}.usda", "/c")
    check_referable(f"/a{character}/b.usda", f"/a{character}")
    with pytest.raises(StageError, match="control character"):
        check_referable(f"/a{character}/b.usda")


def test_a_folder_with_another_name_is_a_link_too(folder: Path) -> None:
    """Oracle: the bytes of a file in it."""
    strange = folder / os.fsdecode(b"d\xff")
    strange.mkdir()
    (strange / "a.usda").write_bytes(b"inside")
    for asked, below in ((strange, "a.usda"), (strange / "a.usda", "")):
        name = readable(asked)
        name.encode("utf-8")
        assert Path(name, below).read_bytes() == b"inside"


def test_only_what_may_be_referred_to_is_linked(folder: Path) -> None:
    """Oracle: the listing of the folder of links: a capture refers to no file beside it."""
    capture = os.fsdecode(b"scan\xff.ply")
    (folder / capture).write_bytes(b"capture")
    assert os.listdir(Path(readable(folder / capture)).parent) == ["scan_xff.ply"]


def test_a_missing_file_is_missing_under_its_new_name_too(folder: Path) -> None:
    """Oracle: the file system."""
    name = readable(folder / os.fsdecode(b"none\xff.usda"))
    name.encode("utf-8")
    assert not Path(name).exists()


def test_the_original_of_a_link_and_of_names_beside_it(folder: Path) -> None:
    """Oracle: the names in the folder that is linked, also of files that do not exist."""
    strange = folder / os.fsdecode(b"d\xff")
    strange.mkdir()
    (strange / "a.usda").write_bytes(b"inside")
    for asked in (folder / STRANGE, strange / "a.usda"):
        assert original(readable(asked)) == str(asked)
    link = Path(readable(folder / STRANGE))
    for name in ("plain.usda", "none.usda", "none/texture.png"):
        assert original(str(link.parent / name)) == str(folder / name)
    assert original(str(folder / "plain.usda")) == str(folder / "plain.usda")
