"""Open what a command is pointed at: a stage as its user wants it, or a capture as a stage."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from pxr import Sdf, Usd

from usdsplat.cli import console
from usdsplat.cli.stage_options import StageOptions
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.files import composition_remarks, is_usd, open_layer, quiet
from usdsplat.interchange.importing import import_capture

_VARIANT = re.compile(r"(/[^:{}]*):([^=]+)=(.*)")


def open_stage_or_capture(
    path: Path,
    options: StageOptions,
    *,
    frame: str | None = None,
    keep: tuple[str, ...] = (),
    progress: Progress = silent,
) -> Usd.Stage:
    """Open a stage as `open_stage` does, or import a capture onto a stage in memory.

    Args:
        path: A file that USD reads, or a capture.
        options: As for `open_stage`; none for a capture.
        frame: Where x, y and z of a capture point; None believes the file.
        keep: As for `open_stage`.
        progress: Told about reading a capture.

    Raises:
        UsageError: If options for stages are given for a capture or the other way around, and as
            `open_stage` does.
        FormatError: If a capture is not what it claims to be.
    """
    if is_usd(path):
        if frame is not None:
            raise UsageError("--frame", "a stage, which says where its axes point", "a capture")
        return open_stage(path, options, keep=keep)
    check_no_stage_options(path, options)
    stage = Usd.Stage.CreateInMemory()
    import_capture(path, stage, frame=frame, progress=progress)
    return stage


def check_no_stage_options(path: Path, options: StageOptions) -> None:
    """Refuse what does nothing for a capture.

    Raises:
        UsageError: If an option was given, the first of them named.
    """
    for item in fields(options):
        if getattr(options, item.name) != item.default:
            flag = f"--{item.name.replace('_', '-')}"
            raise UsageError(flag, f"a capture, {path}", "a stage")


def open_stage(path: Path, options: StageOptions, *, keep: tuple[str, ...] = ()) -> Usd.Stage:
    """Open a stage; the file, and the session layer that was given, are only read.

    What it could not be composed of is remarked on, a sentence each.

    Args:
        path: A file that USD reads.
        options: What to load of it, and how.
        keep: Paths of prims that are loaded whatever the mask is, if they exist.

    Raises:
        StageError: If a layer cannot be opened, or has no prim, variant or layer of a given name.
        UsageError: If an option cannot be understood.
    """
    root = open_layer(path)
    session = Sdf.Layer.CreateAnonymous("session.usda")
    if options.session_layer:
        session.subLayerPaths.append(open_layer(options.session_layer).identifier)
    mask = _mask(options.mask, keep)
    with quiet():
        stage = Usd.Stage.OpenMasked(root, session, mask) if mask else Usd.Stage.Open(root, session)
        if mask:
            check_prims(stage, "--mask", options.mask)
            stage.ExpandPopulationMask()
        _mute(stage, options.mute)
        with Usd.EditContext(stage, session):
            for text in options.variant:
                _select(stage, text)
    for remark in composition_remarks(stage):
        console.remark(remark)
    return stage


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


def check_prims(stage: Usd.Stage, where: str, paths: tuple[str, ...]) -> None:
    """Refuse paths of an option at which the stage has no prim.

    Raises:
        StageError: If there is one.
    """
    for path in paths:
        is_path = Sdf.Path.IsValidPathString(path) and path.startswith("/")
        if not is_path or not stage.GetPrimAtPath(path):
            raise StageError(where, repr(path), "the path of a prim")
