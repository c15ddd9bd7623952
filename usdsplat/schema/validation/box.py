"""Check that the authored extent of a field contains its splats."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from usdsplat.core.errors import UsdSplatError
from usdsplat.core.findings import Finding
from usdsplat.core.wording import counted
from usdsplat.schema import tokens
from usdsplat.schema.extent import compute_extent
from usdsplat.schema.field import fetch
from usdsplat.schema.validation.finding import Sample

_TOLERANCE = 1e-4  # of the diagonal
_SHAPE = (tokens.ORIENTATIONS, tokens.SCALES)
_CURE = "author what usdsplat.schema.compute_extent returns, for every sample that moves"


def extent(sample: Sample) -> Iterator[Finding]:
    """Check `extent`: USD does not compute bounds of splats without it."""
    if not sample.count or not all(sample.is_typed(sample.name(name)) for name in _SHAPE):
        return  # the reach of the splats is unknown
    box = sample.array(tokens.EXTENT)
    if box is None:
        yield sample.finding("error", tokens.EXTENT, "no-extent", "no value", "two corners", _CURE)
        return
    if len(box) != 2:
        found = counted(len(box), "value")
        yield sample.finding("error", tokens.EXTENT, "extent-size", found, "two corners", _CURE)
        return
    try:
        cloud = fetch(sample.prim, sample.code)
    except UsdSplatError:
        return  # other checks report why it cannot be read
    finite = cloud.positions[np.isfinite(cloud.positions).all(axis=1)]
    if not len(finite):
        return
    centres = np.stack([finite.min(axis=0), finite.max(axis=0)])
    needed = compute_extent(cloud)
    slack = _TOLERANCE * float(np.linalg.norm(needed[1] - needed[0]))
    if not _holds(box, centres, 0.0):
        yield _small(sample, "error", box, centres, "hold the centres")
    elif not _holds(box, needed, slack):
        yield _small(sample, "warning", box, needed, "hold the splats")


def _holds(box: np.ndarray, inner: np.ndarray, slack: float) -> bool:
    """Return whether `inner` lies inside `box`; NaN does not."""
    return bool((box[0] <= inner[0] + slack).all() and (box[1] >= inner[1] - slack).all())


def _small(
    sample: Sample, severity: str, box: np.ndarray, needed: np.ndarray, purpose: str
) -> Finding:
    return sample.finding(
        "error" if severity == "error" else "warning",
        tokens.EXTENT,
        "extent-too-small",
        _corners(box),
        f"at least {_corners(needed)} to {purpose}",
        _CURE,
    )


def _corners(box: np.ndarray) -> str:
    return " to ".join("(" + ", ".join(f"{x:.6g}" for x in corner) + ")" for corner in box)
