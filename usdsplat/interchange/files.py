"""Open and save USD files; saving is atomic, and errors are one sentence."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Pcp, Sdf, Tf, Usd, UsdUtils

import usdsplat.schema  # noqa: F401 - our types must be known before the first stage is opened
from usdsplat import formats
from usdsplat.core.errors import OutputError, StageError, UnknownFormatError
from usdsplat.core.output import atomic_path
from usdsplat.core.readable import readable

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


def is_usd(path: Path) -> bool:
    """Return whether the suffix is that of a USD file."""
    return path.suffix.lower() in SUFFIXES


def open_stage(path: Path) -> Usd.Stage:
    """Open a stage.

    Raises:
        StageError: If USD cannot read it.
    """
    layer = open_layer(path)
    with quiet():
        return Usd.Stage.Open(layer)


def open_layer(path: Path, *, anonymous: bool = False) -> Sdf.Layer:
    """Open a layer.

    Args:
        path: File of the layer.
        anonymous: Whether to read a private copy now, even if the layer is open elsewhere.

    Raises:
        StageError: If USD cannot read it.
    """
    if path.is_dir():
        raise StageError(str(path), "a directory", "a USD file")
    if not path.is_file():
        raise StageError(str(path), "no such file", "a USD file")
    if path.name.lower().endswith(formats.suffixes_read()):
        raise StageError(str(path), "a capture", "a USD file")
    found = ""
    try:
        layer = (Sdf.Layer.OpenAsAnonymous if anonymous else Sdf.Layer.FindOrOpen)(readable(path))
    except Tf.ErrorException as error:
        layer, found = None, _sentence(error)
    if not layer:
        raise StageError(str(path), found or "nothing that USD can read", "a USD file")
    return layer


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress USD's composition messages on stderr; `composition_remarks` returns them instead.

    USD prints from C++ to file descriptor 2, which belongs to the whole process: output of other
    threads to stderr during this time is lost too.
    """
    try:
        kept = os.dup(2)
    except OSError:  # without stderr
        yield
        return
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def composition_remarks(stage: Usd.Stage) -> list[str]:
    """Return a sentence for each composition error of a stage, except muted layers."""
    said = [
        " ".join(str(error).partition(" -- ")[0].split()).removesuffix("; skipping.").rstrip(".")
        for error in stage.GetCompositionErrors()
        if not isinstance(error, Pcp.ErrorMutedAssetPath)
    ]
    return sorted(set(said))


def save(layer: Sdf.Layer, target: Path) -> None:
    """Write a layer as .usd, .usda, .usdc or as the only layer of a .usdz.

    Args:
        layer: The layer, which is not modified and need not have a file.
        target: Target; an existing file is replaced when the new one is complete.

    Raises:
        UnknownFormatError: If the suffix is another.
        OutputError: If the target cannot be written.
    """
    check_suffix(target)
    with atomic_path(target) as path, usd_errors(target):
        if target.suffix.lower() == ".usdz":
            _package(layer, target, path)
        else:
            layer.Export(str(path))


@contextmanager
def usd_errors(target: Path) -> Iterator[None]:
    """Convert exceptions of USD while writing to OutputError.

    Raises:
        OutputError: Instead of USD's own.
    """
    try:
        yield
    except Tf.ErrorException as error:
        raise OutputError(str(target), _sentence(error), "a file that USD can write") from None


def check_suffix(target: Path) -> None:
    """Raise an error early for a target that is not a USD file.

    Raises:
        UnknownFormatError: If its suffix is none of `SUFFIXES`.
    """
    if not is_usd(target):
        found = f"suffix {target.suffix!r}"
        raise UnknownFormatError(str(target), found, f"one of {' '.join(SUFFIXES)}")


def check_not_input(target: Path, inputs: Iterable[Path]) -> None:
    """Raise an error if the target is one of the files being read.

    Raises:
        OutputError: If it is, under any name.
    """
    for path in inputs:
        if target.exists() and path.exists() and os.path.samefile(target, path):
            raise OutputError(str(target), "a file that is being read", "another name")


def layer_files(stage: Usd.Stage) -> list[Path]:
    """Return the files that a stage reads, packages included."""
    found = (layer.realPath for layer in stage.GetUsedLayers() if layer.realPath)
    return [Path(path.partition("[")[0]) for path in found]


def _package(layer: Sdf.Layer, target: Path, path: Path) -> None:
    """Write a .usdz with a single crate layer, named like the target."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".usdz-") as folder:
        inner = Path(folder, target.stem + ".usdc")
        layer.Export(str(inner))
        UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(inner)), str(path))


def _sentence(error: Tf.ErrorException) -> str:
    """Return USD's message of its first error on one line."""
    return " ".join(error.args[0].commentary.split()) if error.args else ""
