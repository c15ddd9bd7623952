"""Numbers that tell a person, or a script, what is in a cloud of splats."""

from __future__ import annotations

from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, SplatCloud

PERCENTILES = (1, 50, 99)


def summarize(cloud: SplatCloud) -> dict[str, Any]:
    """Return count, degree, bounds of the centres and percentiles, as JSON can hold them.

    Values that are not finite are counted and otherwise left out. `scale` is the geometric mean of
    the three standard deviations of a splat [scene unit], `opacity` its peak [0..1]; both are given
    at the `PERCENTILES`.
    """
    finite = cloud.positions[np.isfinite(cloud.positions).all(axis=1)]
    # Logarithms, since the product of three small float32 numbers may underflow.
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_scales = np.exp(np.log(cloud.scales.astype(np.float64)).mean(axis=1))
    bounds = [finite.min(axis=0).tolist(), finite.max(axis=0).tolist()] if len(finite) else None
    summary: dict[str, Any] = {
        "splats": len(cloud),
        "sh_degree": cloud.sh_degree,
        "bounds": bounds,
        "scale": _percentiles(mean_scales),
        "opacity": _percentiles(cloud.opacities),
        "ids": cloud.ids is not None,
        "velocities": cloud.velocities is not None,
    }
    arrays = (cloud.positions, cloud.scales, cloud.rotations, cloud.opacities, cloud.sh)
    bad = sum(int(np.count_nonzero(~np.isfinite(array))) for array in arrays)
    return {**summary, "not_finite": bad}


def _percentiles(values: F32 | Any) -> dict[str, float] | None:
    """Percentile -> value; None where there is none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {
        f"p{percent}": float(value)
        for percent, value in zip(PERCENTILES, np.percentile(values, PERCENTILES), strict=True)
    }
