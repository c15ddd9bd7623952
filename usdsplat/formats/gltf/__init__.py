"""glTF 2.0 as text with splats in it: `KHR_gaussian_splatting`, plain or with SPZ inside.

Read only; buffers lie in files beside it or in its own text. See `gltf.parts` for what splats may
look like, `glb` for the one file that holds everything, which can be written too.

Source: Khronos, glTF 2.0 specification and extension KHR_gaussian_splatting.
"""

from __future__ import annotations

from pathlib import Path

from usdsplat.core.errors import FormatError
from usdsplat.formats.capture import Capture
from usdsplat.formats.gltf.splats import TEXT_LIMIT, read_splats
from usdsplat.formats.options import READ_OPTIONS, ReadOptions

SUFFIXES: tuple[str, ...] = (".gltf",)


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file that starts with `head` is a JSON object that calls itself a glTF asset."""
    return head.lstrip()[:1] == b"{" and b'"asset"' in head and b'"version"' in head


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read all splats of the default scene.

    Raises:
        FormatError: If the document is damaged or names what is not there, if a buffer lies outside
            its folder, or if it shows no splats.
    """
    size = path.stat().st_size
    if size > TEXT_LIMIT:
        found, expected = f"{size} bytes of text", f"at most {TEXT_LIMIT}; data in files beside it"
        raise FormatError(str(path), found, expected)
    with path.open("rb") as file:
        return read_splats(path, file.read(TEXT_LIMIT), None, how)
