"""Open a stage as its user wants it, or a capture as a stage; and read it again."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias

from pxr import Sdf, Usd

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.files import open_layer, quiet
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.options import ImportOptions

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
    """Open a stage; the file, and the session layer that was given, are only read.

    The stage's session layer is a new one, which no file belongs to.

    Args:
        path: A file that USD reads.
        variants: Selections, each "/Prim:set=name".
        mute: Regular expressions; layers in whose identifier one is found are left out.
        mask: Paths of the prims to load, with what is below them and what they refer to; none for
            everything.
        session_layer: Opinions stronger than the stage's own.
        keep: Paths of prims that are loaded whatever the mask is, if they exist.

    Raises:
        StageError: If a layer cannot be opened, or has no prim, variant or layer of a given name.
        UsageError: If an option cannot be understood.
    """
    root = open_layer(path)
    session = Sdf.Layer.CreateAnonymous("session.usda")
    if session_layer:
        session.subLayerPaths.append(open_layer(session_layer).identifier)
    populated = _mask(mask, keep)
    with quiet():
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

    Args:
        path: In any format that `formats` reads.
        axes: Where x, y and z of the capture point; None believes the file.
        progress: Told about reading and authoring.

    Raises:
        FormatError: If it is not what it claims to be.
        UsageError: If there are no such axes.
    """
    stage = Usd.Stage.CreateInMemory()
    import_capture(path, stage, options=ImportOptions(axes=axes), progress=progress)
    return stage


def reload(stage: Usd.Stage, changed: Iterable[Path]) -> None:
    """Read the files of a stage again, and those that were missing; its session layer stays.

    Args:
        stage: Its layers lose what was edited in them and not saved.
        changed: Files of the stage that are other than when they were read.

    Raises:
        StageError: If USD cannot read one of them; the stage is as before.
    """
    paths = {str(path) for path in changed}
    for path in sorted(paths):
        open_layer(Path(path), anonymous=True)
    with quiet():
        for layer in stage.GetLayerStack(includeSessionLayers=True):
            if layer.realPath in paths:  # a stage leaves out those of its session
                layer.Reload()
        stage.Reload()


def check_prims(stage: Usd.Stage, where: str, paths: Iterable[str]) -> None:
    """Refuse paths of an option at which the stage has no prim.

    Raises:
        StageError: If there is one.
    """
    for path in paths:
        is_path = Sdf.Path.IsValidPathString(path) and path.startswith("/")
        if not is_path or not stage.GetPrimAtPath(path):
            raise StageError(where, repr(path), "the path of a prim")


def _mask(prims: tuple[str, ...], keep: tuple[str, ...]) -> Usd.StagePopulationMask | None:
    """The prims to load; None for all."""
    for text in prims:
        path = Sdf.Path(text) if Sdf.Path.IsValidPathString(text) else Sdf.Path()
        if not (path.IsAbsolutePath() and path.IsPrimPath()):
            raise UsageError("--mask", repr(text), "the path of a prim, such as /World/Tree")
    return Usd.StagePopulationMask([*prims, *keep]) if prims else None


def _mute(stage: Usd.Stage, patterns: tuple[str, ...]) -> None:
    """Mute every used layer that one of the patterns is found in; the root layer cannot be."""
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
    """Author one variant selection on the current edit target."""
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
