"""Names of files that C++ libraries can open: USD, OpenImageIO and OpenColorIO take UTF-8 only."""

from __future__ import annotations

import atexit
import os
import unicodedata
from contextlib import ExitStack, suppress
from pathlib import Path

from usdsplat.core.errors import StageError
from usdsplat.core.scratch import scratch_folder
from usdsplat.core.text import shown

_links: dict[str, str] = {}
_folders: dict[str, str] = {}
"""Folder of links -> the folder that they are for."""
_REFERRING = (".usd", ".usda", ".usdc", ".ocio")
"""Suffixes of files that refer to others and are read by C++ libraries."""


def readable(path: Path | str) -> str:
    """Return a name of a file or folder that is UTF-8: `path`, or a symbolic link to it.

    Links are in a folder of this process and exist until it ends, because USD reads files late. If
    only the folder has another name, it is linked. Beside a linked file that may refer to others,
    a layer or an OCIO configuration, the other files of its folder are linked too, so that relative
    references are found if they do not leave the folder. A missing file gets a name that does not
    exist either.
    """
    text = str(path)
    if is_utf8(text):
        return text
    full = os.path.abspath(text)
    if not os.path.exists(full):
        return shown(full)
    if full not in _links:
        _links[full] = _linked(full)
    return _links[full]


def original(path: str) -> str:
    """Return the real path of a file whose path contains a symbolic link made by `readable`.

    A path without such a link is returned unchanged. The file need not exist.
    """
    for folder, parent in _folders.items():
        if path.startswith(folder + os.sep):
            first, *rest = path[len(folder) + 1 :].split(os.sep)
            link = os.path.join(folder, first)
            beside = os.path.join(parent, first)
            return os.path.join(os.readlink(link) if os.path.islink(link) else beside, *rest)
    return path


def check_referable(path: Path | str, folder: Path | str | None = None) -> None:
    """Check that a layer may refer to a file.

    Args:
        path: Its path.
        folder: Folder of the layer, which refers to the file by its relative path; None if it does
            by its whole path.

    Raises:
        StageError: If the path is a link of this process, or has control characters, which USD does
            not allow.
    """
    name = str(path)
    if folder is not None:
        with suppress(ValueError):  # another drive
            name = os.path.relpath(path, folder)
    if any(unicodedata.category(each) == "Cc" for each in name):
        found = "a name with a control character"
        raise StageError(str(path), found, "a name that another layer can refer to")
    for full, link in _links.items():
        if str(path) == link:
            found = "a name that is not UTF-8"
            raise StageError(full, found, "a name that another layer can refer to")


def is_utf8(text: str) -> bool:
    """Return whether a name can be encoded in UTF-8."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _linked(full: str) -> str:
    """Return a link to a file whose folder or name is not UTF-8."""
    parent, name = os.path.split(full)
    if is_utf8(name):
        return os.path.join(readable(parent), name)
    folder = ExitStack()
    place = folder.enter_context(scratch_folder())
    _folders[str(place)] = parent
    atexit.register(folder.close)
    has_references = os.path.splitext(name)[1].lower() in _REFERRING
    siblings = os.listdir(parent) if has_references and os.path.isfile(full) else []
    for each in (name, *siblings):
        with suppress(FileExistsError):  # the file itself, or two names with the same plain one
            os.symlink(os.path.join(parent, each), place / _plain(each))
    return str(place / _plain(name))


def _plain(name: str) -> str:
    """Return a name in UTF-8. USD takes the backslash of an escape for a separator of folders."""
    return name if is_utf8(name) else shown(name).replace("\\", "_")
