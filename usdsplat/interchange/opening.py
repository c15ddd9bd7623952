"""Open a stage or a capture as a stage, with options, and reload it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias

from pxr import Sdf, Usd

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.authoring import prepare
from usdsplat.interchange.files import composition_errors, open_layer
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.options import ImportOptions
from usdsplat.interchange.streamed import is_streamed, open_streamed

Stage: TypeAlias = Usd.Stage

_VARIANT = re.compile(r"(/[^:{}]*):([^=]+)=(.*)")


def open_as_asked(
    path: Path,
    *,
    variants: tuple[str, ...] = (),
    mute: tuple[str, ...] = (),
    mask: tuple[str, ...] = (),
    session_layer: Path | None = None,
    keep: tuple[str, ...] = (),
) -> Usd.Stage:
    """Open a stage; its file and the given session layer are only read.

    The stage gets a new, anonymous session layer.

    Args:
        path: A USD file.
        variants: Variant selections, each "/Prim:set=name".
        mute: Regular expressions; layers whose identifier contains a match are muted.
        mask: Paths of the prims to load, with their descendants and the prims they refer to; empty
            for everything.
        session_layer: Layer of opinions stronger than the stage's.
        keep: Paths of prims that are loaded regardless of the mask, if they exist.

    Raises:
        StageError: If a layer cannot be opened, or a named prim, variant or layer does not exist.
        UsageError: If an option is invalid.
    """
    root = open_layer(path)
    session = Sdf.Layer.CreateAnonymous("session.usda")
    if session_layer:
        session.subLayerPaths.append(open_layer(session_layer).identifier)
    populated = _mask(mask, keep)
    with composition_errors(path):
        if populated:
            stage = Usd.Stage.OpenMasked(root, session, populated)
            check_prims(stage, "--mask", mask)
            stage.ExpandPopulationMask()
        else:
            stage = Usd.Stage.Open(root, session)
    _mute(stage, mute)
    with Usd.EditContext(stage, session):
        for text in variants:
            _select(stage, text)
    return stage


def open_capture(path: Path, *, axes: str | None = None, progress: Progress = silent) -> Usd.Stage:
    """Import a capture onto a stage in memory.

    A streamed SOG becomes a splat tree, whose splats are read when they are drawn.

    Args:
        path: A capture in any format that `formats` reads.
        axes: Axes of the capture; None chooses them, see `ImportOptions.axes`.
        progress: Receives the progress of reading and authoring.

    Raises:
        FormatError: If the capture is invalid.
        UsageError: If the axes are invalid.
    """
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, None, None)
    if is_streamed(path):
        open_streamed(path, stage, axes=axes, progress=progress)
        return stage
    import_capture(path, stage, options=ImportOptions(axes=axes), progress=progress)
    return stage


def reload(stage: Usd.Stage, changed: Iterable[Path]) -> None:
    """Reload the files of a stage, including missing ones; its session layer stays.

    Args:
        stage: The stage; unsaved edits of its layers are lost.
        changed: Files of the stage that have changed since they were read.

    Raises:
        StageError: If USD cannot read one of them; the stage is then unchanged.
    """
    paths = {str(path) for path in changed}
    for path in sorted(paths):
        open_layer(Path(path), anonymous=True)
    for layer in stage.GetLayerStack(includeSessionLayers=True):
        if layer.realPath in paths:  # Stage.Reload skips layers of the session
            layer.Reload()
    stage.Reload()


def check_prims(stage: Usd.Stage, where: str, paths: Iterable[str]) -> None:
    """Raise an error if the stage has no prim at a path of an option.

    Raises:
        StageError: If a prim is missing.
    """
    for path in paths:
        is_path = Sdf.Path.IsValidPathString(path) and path.startswith("/")
        if not is_path or not stage.GetPrimAtPath(path):
            raise StageError(where, repr(path), "the path of a prim of the stage")


def _mask(prims: tuple[str, ...], keep: tuple[str, ...]) -> Usd.StagePopulationMask | None:
    """Return the population mask; None for all prims."""
    for text in prims:
        path = Sdf.Path(text) if Sdf.Path.IsValidPathString(text) else Sdf.Path()
        if not (path.IsAbsolutePath() and path.IsPrimPath()):
            raise UsageError("--mask", repr(text), "the path of a prim, such as /World/Tree")
    return Usd.StagePopulationMask([*prims, *keep]) if prims else None


def _mute(stage: Usd.Stage, patterns: tuple[str, ...]) -> None:
    """Mute every used layer that matches a pattern, except for the root layer."""
    for text in patterns:
        try:
            pattern = re.compile(text)
        except re.error as error:
            raise UsageError("--mute", repr(text), f"a regular expression ({error})") from None
        used = [layer.identifier for layer in stage.GetUsedLayers() if not layer.anonymous]
        used.remove(stage.GetRootLayer().identifier)
        matching = [identifier for identifier in used if pattern.search(identifier)]
        if not matching:
            names = ", ".join(sorted(Path(identifier).name for identifier in used)) or "none"
            raise StageError("--mute", repr(text), f"part of the name of a used layer: {names}")
        stage.MuteAndUnmuteLayers(matching, [])


def _select(stage: Usd.Stage, text: str) -> None:
    """Author a variant selection on the current edit target."""
    match = _VARIANT.fullmatch(text)
    if not match:
        raise UsageError("--variant", repr(text), "/Prim:set=name")
    path, set_name, name = match.groups()
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if not prim:
        raise StageError("--variant", f"no prim {path}", "the path of a prim of the stage")
    sets = prim.GetVariantSets()
    if set_name not in sets.GetNames():
        known = ", ".join(sets.GetNames()) or "none"
        raise StageError(f"--variant {path}", f"no set {set_name!r}", f"one of its sets: {known}")
    variants = sets.GetVariantSet(set_name)
    if name not in variants.GetVariantNames():
        known = ", ".join(variants.GetVariantNames())
        raise StageError(f"--variant {path}:{set_name}", repr(name), f"one of {known}")
    variants.SetVariantSelection(name)
