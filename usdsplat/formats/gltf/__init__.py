"""Read glTF 2.0 text files with splats: `KHR_gaussian_splatting`, plain or with SPZ inside.

Read only. Buffers are separate files in the same folder, or data URIs. `gltf.parts` describes the
supported layouts; `glb` is the binary form, which can also be written.

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
    """Return whether a file that starts with `head` is a JSON object with glTF's keys "asset" and
    "version"."""
    return head.lstrip()[:1] == b"{" and b'"asset"' in head and b'"version"' in head


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read all splats of the default scene.

    Raises:
        FormatError: If the document is damaged or refers to something missing, if a buffer lies
            outside the document's folder, or if the scene shows no splats.
    """
    size = path.stat().st_size
    if size > TEXT_LIMIT:
        found, expected = f"{size} bytes of text", f"at most {TEXT_LIMIT}; data in files beside it"
        raise FormatError(str(path), found, expected)
    with path.open("rb") as file:
        return read_splats(path, file.read(TEXT_LIMIT), None, how)
