"""Name the files of a tree, and put them in place together."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf

from usdsplat.core.errors import OutputError, StageError, UsageError
from usdsplat.core.output import output_file, output_group
from usdsplat.core.readable import check_referable, is_utf8
from usdsplat.interchange import files
from usdsplat.interchange.lod.coarse import FILE
from usdsplat.schema import tokens
from usdsplat.schema.usd_files import is_whole_usd, write_copy

_SUFFIXES = (".usd", ".usda", ".usdc")
_OURS = re.compile(rf"\d{{4,}}\.usdc|{re.escape(FILE)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeFiles:
    """The files of a tree: `city.usda`, and its chunks in the folder `city_chunks`, with the layer
    of its coarse levels."""

    target: Path
    folder: Path

    @classmethod
    def of(cls, target: Path, inputs: Iterable[Path]) -> TreeFiles:
        """Return the files of a tree after checking that they can be written.

        Args:
            target: File of the tree.
            inputs: Files that are read.

        Raises:
            UnknownFormatError: If the target is not a USD file.
            UsageError: If it is a package, which cannot refer to a folder.
            OutputError: If there is no folder for the target, a file would replace an input, or the
                folder of the chunks exists with other content.
            StageError: If a layer cannot refer to chunks with the name of the target.
        """
        files.check_suffix(target, packages=False)
        if target.suffix.lower() == ".usdz":
            raise UsageError("--output", f"{target}, a package", "a .usd, .usda or .usdc file")
        final = Path(os.path.realpath(target))
        if not final.parent.is_dir():
            raise OutputError(str(target), f"no folder {final.parent}", "an existing folder")
        folder = final.with_name(f"{target.stem}_chunks")
        check_referable(folder, final.parent)
        if not is_utf8(folder.name):
            found = "a name that is not UTF-8"
            raise OutputError(str(target), found, "a name of chunks that the tree can refer to")
        known = list(inputs)
        files.check_not_input(target, known)
        for path in known:
            if folder in Path(os.path.realpath(path)).parents:
                raise OutputError(str(folder), f"{path.name}, which is being read", "another name")
        if os.path.lexists(folder):
            is_folder = folder.is_dir() and not folder.is_symlink()
            if not is_folder or not all(_OURS.fullmatch(name) for name in os.listdir(folder)):
                found = "something that is not a folder of chunks"
                raise OutputError(str(folder), found, "earlier chunks or nothing")
            for other in (final.with_suffix(suffix) for suffix in _SUFFIXES):
                if other != final and _refers(other, folder.name):
                    found = f"the chunks of {other.name}"
                    raise OutputError(str(folder), found, "another name, or no such folder")
        return cls(target=target, folder=folder)

    def asset(self, name: str) -> str:
        """Return the path of a file in the folder as the tree refers to it."""
        return f"./{self.folder.name}/{name}"

    def place(self, layer: Sdf.Layer, made_files: Iterable[Path]) -> None:
        """Write the layer of the tree, and put it and the files that it refers to in place of
        earlier ones.

        Args:
            layer: The layer, which is not modified.
            made_files: Finished files for the folder; they may be gone afterwards.

        Raises:
            OutputError: If a file cannot be written.
        """
        with output_group() as group, output_file(self.target, is_whole=is_whole_usd) as output:
            write_copy(layer, output)
            made = output.path.parent / self.folder.name
            made.mkdir()
            for path in made_files:
                try:
                    (made / path.name).hardlink_to(path)
                except OSError:  # a file system without links
                    shutil.move(path, made / path.name)
            group.place_folder(made, self.folder)


def _refers(target: Path, folder: str) -> bool:
    """Return whether a layer has a splat tree with chunks in a folder beside it."""
    if not target.is_file():
        return False
    try:
        layer = files.open_layer(target)
    except StageError:
        return False
    found: list[str] = []

    def visit(path: Sdf.Path) -> None:
        if path.IsPropertyPath() and path.name == tokens.CHUNKS:
            assets = layer.GetAttributeAtPath(path).default or ()
            found.extend(each.path for each in assets if each.path.startswith(f"./{folder}/"))

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return bool(found)
