"""Open and save USD files; saving is atomic, and errors are one sentence."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, Usd

from usdsplat import formats
from usdsplat.core.errors import OutputError, StageError, UnknownFormatError
from usdsplat.core.readable import readable
from usdsplat.schema.usd_files import export_layer, sentence
from usdsplat.schema.value_clips import stage_files

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
PAGE_SUFFIX = ".html"


def is_usd(path: Path) -> bool:
    """Return whether the suffix is that of a USD file."""
    return path.suffix.lower() in SUFFIXES


def is_page(target: Path | str) -> bool:
    """Return whether the suffix is that of a page for a browser."""
    return str(target).lower().endswith(PAGE_SUFFIX)


def open_stage(path: Path) -> Usd.Stage:
    """Open a stage.

    Raises:
        StageError: If USD cannot read it.
    """
    layer = open_layer(path)
    with composition_errors(path):
        return Usd.Stage.Open(layer)


@contextmanager
def composition_errors(path: Path) -> Iterator[None]:
    """Convert exceptions of USD while it composes a stage.

    Raises:
        StageError: Instead of USD's own.
    """
    try:
        yield
    except Tf.ErrorException as error:
        found = sentence(error) or "nothing that USD can compose"
        raise StageError(str(path), found, "a stage that USD can compose") from None


def open_layer(path: Path, *, anonymous: bool = False) -> Sdf.Layer:
    """Open a layer.

    Args:
        path: File of the layer.
        anonymous: Whether to read a private copy now, even if the layer is open elsewhere.

    Raises:
        StageError: If USD cannot read it.
    """
    check_layer_file(path)
    found = ""
    try:
        layer = (Sdf.Layer.OpenAsAnonymous if anonymous else Sdf.Layer.FindOrOpen)(readable(path))
    except Tf.ErrorException as error:
        layer, found = None, sentence(error)
    if not layer:
        raise StageError(str(path), found or "nothing that USD can read", "a USD file")
    return layer


def check_layer_file(path: Path) -> None:
    """Raise an error for what cannot be the file of a layer, without opening it.

    Raises:
        StageError: If there is no file, or it is a capture.
    """
    if path.is_dir():
        raise StageError(str(path), "a directory", "a USD file")
    if not path.is_file():
        raise StageError(str(path), "no such file", "a USD file")
    if path.name.lower().endswith(formats.suffixes_read()):
        expected = "a USD file; usdsplat convert makes one"
        raise StageError(str(path), "a capture", expected)


def save(layer: Sdf.Layer, target: Path) -> None:
    """Write a layer as .usd, .usda, .usdc or .usdz, as `export_layer` does.

    Args:
        layer: The layer, which is not modified and need not have a file.
        target: Target; an existing file is replaced when the new one is complete.

    Raises:
        UnknownFormatError: If the suffix is another.
        OutputError: If the target cannot be written.
    """
    check_suffix(target)
    export_layer(layer, target)


def check_suffix(target: Path, *, packages: bool = True) -> None:
    """Raise an error early for a target that is not a USD file.

    Args:
        target: The target.
        packages: Whether the error names the suffix of packages, too.

    Raises:
        UnknownFormatError: If its suffix is none of `SUFFIXES`.
    """
    if not is_usd(target):
        found = f"suffix {target.suffix!r}"
        names = SUFFIXES if packages else SUFFIXES[:-1]
        raise UnknownFormatError(str(target), found, f"one of {' '.join(names)}")


def capture_files(path: Path) -> tuple[str, ...]:
    """Return the absolute paths of the files of a capture: the file itself, or all in the folder of
    an unpacked SOG; empty for a stage."""
    if is_usd(path):
        return ()
    if path.name.lower() not in ("meta.json", "lod-meta.json"):
        return (str(path.absolute()),)
    files = sorted(each for each in path.absolute().parent.rglob("*") if each.is_file())
    return tuple(map(str, files))


def read_whole(path: Path) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return those of `capture_files` that are read as a whole, and those that are read only where
    they are seen: the chunks of a streamed SOG."""
    files = tuple(map(Path, capture_files(path)))
    if path.name.lower() != "lod-meta.json":
        return files, ()
    whole = tuple(each for each in files if each.name == path.name)
    return whole, tuple(each for each in files if each.name != path.name)


def check_not_input(target: Path, inputs: Iterable[Path]) -> None:
    """Raise an error if the target is one of the files being read.

    Raises:
        OutputError: If it is, under any name.
    """
    for path in inputs:
        if os.path.exists(target) and os.path.exists(path) and os.path.samefile(target, path):
            raise OutputError(str(target), "a file that is being read", "another name")


def layer_files(stage: Usd.Stage) -> list[Path]:
    """Return the files that a stage reads, packages and unread value clips included."""
    return [Path(path) for path in sorted(stage_files(stage))]
