"""Findings about the composition of a stage: missing layers and prims, invalid arcs, units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from pxr import Pcp, Usd

from usdsplat.core.findings import Finding, finding
from usdsplat.formats import suffixes_read
from usdsplat.schema.metrics import metrics_findings
from usdsplat.schema.stage_values import in_world
from usdsplat.schema.value_clips import clip_assets

_ASSET = re.compile(r"Could not open asset @(.*?)@ for (\w+) introduced by .*?( -- .*)?$")
_SUBLAYER = re.compile(r"Could not load sublayer @(.*?)@ of layer @(.*?)@(.*)")
_PRIM = re.compile(r"Unresolved (\w+) prim path @(.*?)@<(.*?)> introduced by")
_SITE = re.compile(r"@<(/[^>]*)>")
_ANONYMOUS = re.compile(r",?@anon:[^@]*@")
"""Text of the messages of Pcp, whose errors state no more in Python."""


def composition_findings(stage: Usd.Stage) -> list[Finding]:
    """Return what the arcs of a stage ask for and do not get: a finding for each composition error,
    except muted layers, each missing file of a value clip, each asset with another unit or up axis,
    and each instance with opinions below it, which USD ignores; by path."""
    prims = list(in_world(stage))
    found = [
        *_errors(stage),
        *metrics_findings(stage, prims),
        *_clips(prims),
        *_ignored(stage, prims),
    ]
    once = {each.key: each for each in found}
    return sorted(once.values(), key=lambda each: (each.path, each.found))


def _errors(stage: Usd.Stage) -> list[Finding]:
    """Return a finding for each composition error of a stage, except muted layers."""
    errors = [
        error
        for error in stage.GetCompositionErrors()
        if not isinstance(error, Pcp.ErrorMutedAssetPath)
    ]
    if not errors:
        return []
    placed = [
        (str(prim.GetPath()), error)
        for prim in Usd.PrimRange.Stage(stage, Usd.PrimAllPrimsPredicate)
        for error in prim.GetPrimIndex().localErrors
        if not isinstance(error, Pcp.ErrorMutedAssetPath)
    ]
    known = {str(error) for _, error in placed}
    placed += [(_site(error), error) for error in errors if str(error) not in known]
    return [_finding(path, error) for path, error in placed]


def _clips(prims: Iterable[Usd.Prim]) -> Iterator[Finding]:
    """Yield a finding for each missing file of a value clip."""
    for prim, asset in clip_assets(prims):
        if not asset.resolvedPath:
            found = f"no file {asset.path} for a value clip"
            yield finding("missing-asset", str(prim.GetPath()), found, "a layer that USD can read")


def _ignored(stage: Usd.Stage, prims: Iterable[Usd.Prim]) -> Iterator[Finding]:
    """Yield a finding for each instance below which the stage's own layers have opinions."""
    layers = stage.GetLayerStack()
    for prim in prims:
        if prim.IsInstance() and not prim.IsInstanceProxy():
            specs = filter(None, (layer.GetPrimAtPath(prim.GetPath()) for layer in layers))
            names = sorted({child.name for spec in specs for child in spec.nameChildren})
            if names:
                found = f"opinions on {', '.join(names)} below an instanceable prim"
                yield finding(
                    "ignored-opinion", str(prim.GetPath()), found, "none: USD ignores them"
                )


def _finding(path: str, error: Pcp.ErrorBase) -> Finding:
    """Return the finding on an error at a prim."""
    text = " ".join(str(error).split())
    if match := _ASSET.match(text):
        found = f"no file {match[1]} for a {match[2]}"
        if match[3]:
            found = f"{match[1]} for a {match[2]}, which USD cannot read"
        return finding("missing-asset", path, found, _layer_of(match[1]))
    if match := _SUBLAYER.match(text):
        found = f"no sublayer {match[1]} of {match[2]}"
        if " -- " in match[3]:
            found = f"a sublayer {match[1]} of {match[2]}, which USD cannot read"
        return finding("missing-asset", "/", found, _layer_of(match[1]))
    if match := _PRIM.match(text):
        prim = "no default prim" if match[3] == "defaultPrim" else f"no prim {match[3]}"
        found = f"a {match[1]} to {match[2]}, which has {prim}"
        return finding("missing-prim", path, found, "a prim that exists")
    found = _ANONYMOUS.sub("", text).rstrip(". ")
    return finding("composition", path, found, "what USD can compose")


def _layer_of(asset: str) -> str:
    """Return what is expected in place of an asset, a capture or not."""
    expected, name = "a layer that USD can read", asset.lower()
    if name.endswith("lod-meta.json"):
        return f"{expected}, such as a tree that usdsplat lod makes of it"
    if name.endswith(suffixes_read()):
        return f"{expected}, such as one that usdsplat convert makes of it"
    return expected


def _site(error: Pcp.ErrorBase) -> str:
    """Return the path that an error names first, or that of the pseudo-root."""
    match = _SITE.search(str(error.rootSite)) or _SITE.search(str(error))
    return match[1] if match else "/"
