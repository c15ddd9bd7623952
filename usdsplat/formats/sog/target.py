"""Write a SOG to a zip archive or a folder, completely or not at all."""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import IO

from usdsplat.core.errors import FormatError, OutputError
from usdsplat.core.output import is_private, output_file, output_group, write_output
from usdsplat.formats.sog.encoding import EncodedSog
from usdsplat.formats.sog.meta import META, META_LIMIT, parse_meta

_NUMBER = re.compile(r"\.([0-9]+\.)?")
"""The end of the stem of an image, with the number of `_free_name` if it has one."""


def write_archive(path: Path, sog: EncodedSog) -> None:
    """Write a zip file without compression, because the images are compressed already.

    Raises:
        OutputError: If the target cannot be written.
    """
    with output_file(path) as output, output.open() as file:
        write_zip(file, sog)


def write_zip(file: IO[bytes], sog: EncodedSog) -> None:
    """Write a zip archive without compression to an open file."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, data in {META: sog.meta({}), **sog.images}.items():
            # No date, so that equal splats give equal files.
            archive.writestr(zipfile.ZipInfo(name), data)


def write_folder(meta: Path, sog: EncodedSog) -> None:
    """Write into the folder of `meta`, which must be new, empty or hold a SOG.

    The images get unused names. When all are in place, the new `meta.json`, which names them,
    replaces the old one. Then the images that the old one named are deleted. A reader therefore
    finds the old or the new SOG complete at any time.

    Raises:
        OutputError: If the folder has other files but no SOG, or cannot be written.
    """
    folder = Path(os.path.realpath(meta.parent))
    old = _images_of(str(meta), folder, sog.images)
    names = {name: _free_name(folder, name) for name in sog.images}
    try:
        with output_group() as group:
            if not folder.exists():
                group.make_folder(folder)
            for name, data in sog.images.items():
                write_output(folder / names[name], data)
            write_output(folder / META, sog.meta(names))
            for name in old:
                group.remove_later(folder / name)
    except OutputError:
        raise
    except OSError as error:
        found = (error.strerror or str(error)).lower()
        raise OutputError(str(meta), found, "a folder that can be written") from error


def _images_of(target: str, folder: Path, images: Collection[str]) -> list[str]:
    """Return the images of the SOG in a folder, none if it is new or empty.

    Images without the file that names them are those of a writer that was killed.
    """
    expected = "a new or an empty folder, or one that holds a SOG"
    if not folder.exists():
        return []
    if not folder.is_dir():
        raise OutputError(target, f"a file {folder.name}", expected)
    meta = folder / META
    if not meta.exists():
        left = [name for name in os.listdir(folder) if not is_private(name)]
        if not all(_NUMBER.sub(".", name) in images for name in left):
            raise OutputError(target, "a folder with other files", expected)
        return left
    try:
        with meta.open("rb") as file:
            named = parse_meta(target, file.read(META_LIMIT)).files
    except FormatError as error:
        raise OutputError(target, f"a {META} of something else", expected) from error
    return [name for name in named if Path(name).name == name and name.endswith(".webp")]


def _free_name(folder: Path, name: str) -> str:
    """Return `name`, with a number inserted if the folder already has such a file."""
    path = Path(name)
    number = 0
    while (folder / name).exists():
        number += 1
        name = f"{path.stem}.{number}{path.suffix}"
    return name
