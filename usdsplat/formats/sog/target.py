"""Where a SOG is written: a zip archive, or a folder, whole or not at all."""

from __future__ import annotations

import os
import zipfile
from contextlib import suppress
from pathlib import Path

from usdsplat.core.errors import FormatError, OutputError
from usdsplat.core.output import atomic_path
from usdsplat.formats.sog.encoding import EncodedSog
from usdsplat.formats.sog.meta import META, META_LIMIT, parse_meta


def write_archive(path: Path, sog: EncodedSog) -> None:
    """Write a zip file; nothing in it is deflated, for images are packed already.

    Raises:
        OutputError: If nothing can be written there.
    """
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive,
    ):
        for name, data in {META: sog.meta({}), **sog.images}.items():
            archive.writestr(zipfile.ZipInfo(name), data)  # of no date: equal splats, equal files


def write_folder(meta: Path, sog: EncodedSog) -> None:
    """Write into the folder of `meta`, which is new, empty or holds a SOG.

    The images come first, under names that nothing there has; then `meta.json` takes the place of
    its older self and names them; then those that it named before go. So a reader finds the old
    SOG or the new one at any time.

    Raises:
        OutputError: If the folder has other files but no SOG, or nothing can be written there.
    """
    folder = Path(os.path.realpath(meta.parent))
    old = _images_of(str(meta), folder)
    is_new = not folder.exists()
    names = {name: _free_name(folder, name) for name in sog.images}
    written: list[Path] = []
    try:
        if is_new:
            folder.mkdir()
        for name, data in sog.images.items():
            written.append(folder / names[name])
            written[-1].write_bytes(data)
        with atomic_path(folder / META) as temporary:
            temporary.write_bytes(sog.meta(names))
    except BaseException as error:
        for path in written:
            path.unlink(missing_ok=True)
        if is_new and folder.is_dir():
            folder.rmdir()
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            found = (error.strerror or str(error)).lower()
            raise OutputError(str(meta), found, "a folder that can be written") from error
        raise
    for name in old:
        with suppress(OSError):  # the new one is whole
            (folder / name).unlink()


def _images_of(target: str, folder: Path) -> list[str]:
    """Images that the SOG in a folder names, none if it is new or empty."""
    expected = "a new or an empty folder, or one that holds a SOG"
    if not folder.exists():
        return []
    if not folder.is_dir():
        raise OutputError(target, f"a file {folder.name}", expected)
    meta = folder / META
    if not meta.exists():
        if any(folder.iterdir()):
            raise OutputError(target, "a folder with other files", expected)
        return []
    try:
        with meta.open("rb") as file:
            named = parse_meta(target, file.read(META_LIMIT)).files
    except FormatError as error:
        raise OutputError(target, f"a {META} of something else", expected) from error
    return [name for name in named if Path(name).name == name and name.endswith(".webp")]


def _free_name(folder: Path, name: str) -> str:
    """`name`, or with a number in it if the folder has that already."""
    path = Path(name)
    number = 0
    while (folder / name).exists():
        number += 1
        name = f"{path.stem}.{number}{path.suffix}"
    return name
