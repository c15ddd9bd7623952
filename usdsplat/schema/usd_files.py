"""Write USD files completely or not at all.

USD reports failures in three ways: exceptions, results, and files that are incomplete. Here each of
them becomes an OutputError. All USD files are written by this module.
"""

from __future__ import annotations

import io
import os
import struct
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, UsdUtils

from usdsplat.core.errors import OutputError
from usdsplat.core.output import OutputFile, output_file
from usdsplat.core.renames import EXPECTED
from usdsplat.schema import usdz

_CRATE, _TEXT, _ZIP = b"PXR-USDC", b"#usda ", b"PK\3\4"
_SECTION = struct.Struct("<16sqq")
"""Name, offset and size of a section of a crate file."""
_SECTIONS = 64
"""Largest number of sections that is taken for sane; there are six."""
MOST_TEXT = 400
"""Largest number of characters of a message of USD that is quoted."""


@contextmanager
def usd_errors(target: Path | str) -> Iterator[None]:
    """Convert exceptions of USD while writing to OutputError.

    Raises:
        OutputError: Instead of USD's own.
    """
    try:
        yield
    except Tf.ErrorException as error:
        found = sentence(error)
        raise OutputError(str(target), found, "a file that USD can write") from None


def sentence(error: Tf.ErrorException) -> str:
    """Return USD's message of its first error on one line, cut after `MOST_TEXT` characters: of a
    damaged layer it names every broken value."""
    text = " ".join(error.args[0].commentary.split()) if error.args else ""
    return text if len(text) <= MOST_TEXT else f"{text[:MOST_TEXT]} ..."


def new_layer(path: Path, output: OutputFile) -> Sdf.Layer:
    """Make an empty layer in a file in the private folder of an output; see `save_layer`.

    Raises:
        OutputError: If the file cannot be made.
    """
    with usd_errors(output.target):
        layer = Sdf.Layer.CreateNew(OutputFile(output.target, path).text)
    if not layer:
        raise OutputError(output.target, "a file that cannot be made", EXPECTED)
    return layer


def export_layer(layer: Sdf.Layer, target: Path | str) -> None:
    """Write a copy of a layer to a file, in the format of its suffix.

    Args:
        layer: The layer, which is not modified and need not have a file.
        target: A .usd, .usda or .usdc file, or a .usdz, in which the layer and what it refers to
            are packed.

    Raises:
        OutputError: If the file cannot be written.
    """
    with output_file(target, is_whole=is_whole_usd) as output:
        if output.path.suffix.lower() == ".usdz":
            crate = output.path.with_name(crate_name(target))
            write_copy(layer, output, crate)
            package_layer(crate, output)
        else:
            write_copy(layer, output)


def write_copy(layer: Sdf.Layer, output: OutputFile, path: Path | None = None) -> None:
    """Write a copy of a layer as an output, or to another path in its private folder.

    Raises:
        OutputError: If the file cannot be written.
    """
    path = path or output.path
    with usd_errors(output.target):
        is_written = layer.Export(OutputFile(output.target, path).text)
    if not (is_written and is_whole_usd(path)):
        raise OutputError(output.target, "a truncated file", EXPECTED)


def save_layer(layer: Sdf.Layer, output: OutputFile) -> None:
    """Save a layer of `new_layer` in its file.

    Raises:
        OutputError: If the file cannot be written.
    """
    with usd_errors(output.target):
        is_saved = layer.Save()
    if not (is_saved and is_whole_usd(Path(layer.realPath))):
        raise OutputError(output.target, "a truncated file", EXPECTED)


def package_layer(layer: Path, output: OutputFile) -> None:
    """Pack a layer's file, and the files that it refers to, as a .usdz.

    The members are those of `UsdUtils.CreateNewUsdzPackage`, in its order.

    Raises:
        OutputError: If the package cannot be written.
    """
    text = OutputFile(output.target, layer).text
    with usd_errors(output.target):
        delegate = UsdUtils.CoalescingDiagnosticDelegate()  # packing prints the same messages
        layers, assets, missing = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(text))
        del delegate
    with usd_errors(output.target), output.open() as file:
        if len(layers) == 1 and not assets and not missing:
            with layer.open("rb") as source:
                usdz.write(file, [(layer.name, source)], where=output.target)
            return
        packed = output.path.with_name("packed.usdz")
        is_packed = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(text), str(packed))
        if not (is_packed or missing):  # the result is also false if a file is missing
            raise OutputError(output.target, "a truncated file", EXPECTED)
        try:
            with zipfile.ZipFile(packed, metadata_encoding="utf-8") as archive:
                members = ((name, archive.open(name)) for name in archive.namelist())
                usdz.write(file, members, where=output.target)
        except zipfile.BadZipFile as error:
            raise OutputError(output.target, "a truncated file", EXPECTED) from error


def is_whole_usd(path: Path) -> bool:
    """Return whether a file that USD has written is complete.

    The sections of a crate file must be in it. Text must end as USD ends it, and a package with its
    list of members.
    """
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        start = file.read(24)
        if start.startswith(_CRATE):
            return len(start) == 24 and _has_sections(file, struct.unpack("<q", start[16:])[0])
        file.seek(max(0, size - usdz.END_SIZE))
        last = file.read()
        if start.startswith(_TEXT):
            return last.endswith(b"\n")
        return start.startswith(_ZIP) and last.startswith(usdz.END)


def _has_sections(file: io.BufferedReader, contents: int) -> bool:
    """Return whether the sections of a crate file, which the table at `contents` names, are in
    it."""
    size = file.seek(0, os.SEEK_END)
    if not 0 < contents <= size - 8:
        return False
    file.seek(contents)
    (count,) = struct.unpack("<Q", file.read(8))
    if not 0 < count <= _SECTIONS or contents + 8 + count * _SECTION.size > size:
        return False
    sections = _SECTION.iter_unpack(file.read(count * _SECTION.size))
    return all(start > 0 and start + length <= size for _, start, length in sections)


def crate_name(target: Path | str) -> str:
    """Return the name of the layer in a package: that of the package, in UTF-8."""
    return Path(target).stem.encode(errors="replace").decode() + ".usdc"
