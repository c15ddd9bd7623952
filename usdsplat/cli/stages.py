"""Open what a command is pointed at: a stage as its user wants it, or a capture as a stage."""

from __future__ import annotations

import re
from pathlib import Path

from pxr import Sdf, Tf, Usd

from usdsplat.cli.stage_options import StageOptions
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.files import is_usd
from usdsplat.interchange.importing import import_capture

_VARIANT = re.compile(r"(/[^:{}]*):([^=]+)=(.*)")


def open_stage_or_capture(
    path: Path, options: StageOptions, *, keep: tuple[str, ...] = (), progress: Progress = silent
) -> Usd.Stage:
    """Open a stage as `open_stage` does, or import a capture onto a stage in memory.

    Raises:
        UsageError: If options for stages are given for a capture, and as `open_stage` does.
        FormatError: If a capture is not what it claims to be.
    """
    if is_usd(path):
        return open_stage(path, options, keep=keep)
    if options != StageOptions():
        raise UsageError(str(path), "options for stages with a capture", "a USD file")
    stage = Usd.Stage.CreateInMemory()
    import_capture(path, stage, progress=progress)
    return stage


def open_stage(path: Path, options: StageOptions, *, keep: tuple[str, ...] = ()) -> Usd.Stage:
    """Open a stage; the file, and the session layer that was given, are only read.

    Args:
        path: A file that USD reads.
        options: What to load of it, and how.
        keep: Paths of prims that are loaded whatever the mask is, if they exist.

    Raises:
        StageError: If a layer cannot be opened, or has no prim, variant or layer of a given name.
        UsageError: If an option cannot be understood.
    """
    root = _layer(path)
    session = Sdf.Layer.CreateAnonymous("session.usda")
    if options.session_layer:
        session.subLayerPaths.append(_layer(options.session_layer).identifier)
    mask = _mask(options.mask, keep)
    stage = Usd.Stage.OpenMasked(root, session, mask) if mask else Usd.Stage.Open(root, session)
    if mask:
        stage.ExpandPopulationMask()
    _mute(stage, options.mute)
    with Usd.EditContext(stage, session):
        for text in options.variant:
            _select(stage, text)
    return stage


def _layer(path: Path) -> Sdf.Layer:
    """Open a layer, or say in a sentence why not."""
    if not path.is_file():
        raise StageError(str(path), "no such file", "a USD layer")
    try:
        return Sdf.Layer.FindOrOpen(str(path)) or _refused(path, "nothing that USD can read")
    except Tf.ErrorException as error:
        return _refused(path, error.args[0].commentary if error.args else "an error of USD's")


def _refused(path: Path, found: str) -> Sdf.Layer:
    raise StageError(str(path), " ".join(found.split()), "a USD layer")


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
