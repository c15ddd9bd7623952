"""Deep samples of some rows of a picture, on the host."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32

DEEP_IDS = ("primId", "instanceId", "elementId")
"""AOVs that a deep sample can have as ids."""


@dataclass(frozen=True, slots=True, eq=False)
class DeepSamples:
    """Deep samples of a band, near to far, pixel after pixel."""

    counts: npt.NDArray[np.uint32]
    """Number of samples of each pixel, shape (h, w)."""
    depth: F32
    """Nearest depth of each sample, shape (n,)."""
    depth_back: F32
    """Farthest depth of each sample, shape (n,)."""
    color: F32
    """Premultiplied RGBA of each sample alone, shape (n, 4)."""

    left: F32
    """Transmittance of a deep holdout to a surface behind the samples of each pixel; 1 without a
    holdout, shape (h, w)."""
    ids: I32 = field(default_factory=lambda: np.empty((0, 0), np.int32))
    """Requested ids of each sample, one column for each, shape (n, k)."""
    id_names: tuple[str, ...] = ()
    """Names of the columns of `ids`, in the order of DEEP_IDS."""
    prims: tuple[str, ...] = ()
    """Paths of the prims that primId numbers; empty without ids."""

    def with_surfaces(
        self, surface_depth: F32, drawn: npt.NDArray[np.bool_], colors: F32, ids: I32
    ) -> DeepSamples:
        """Return the samples with one sample added per pixel where a surface is drawn.

        The added sample is the last one of its pixel.

        Args:
            surface_depth: Depth of the surface, shape (h, w).
            drawn: Whether a surface is drawn, shape (h, w).
            colors: Its linear RGB, shape (h, w, 3).
            ids: All its ids, in the order of DEEP_IDS, shape (3, h, w).
        """
        ends = np.cumsum(self.counts, dtype=np.int64)
        more = np.cumsum(drawn.ravel(), dtype=np.int64)
        places = ends[drawn.ravel()] + more[drawn.ravel()] - 1
        kept = np.ones(len(self.depth) + int(more[-1]), bool)
        kept[places] = False

        def merged(samples: npt.NDArray[Any], surfaces: npt.NDArray[Any]) -> npt.NDArray[Any]:
            out = np.empty((len(kept), *samples.shape[1:]), samples.dtype)
            out[kept], out[places] = samples, surfaces
            return out

        columns = [DEEP_IDS.index(name) for name in self.id_names]
        left = self.left[drawn][:, None]
        return replace(
            self,
            counts=self.counts + drawn.astype(np.uint32),
            depth=merged(self.depth, surface_depth[drawn]),
            depth_back=merged(self.depth_back, surface_depth[drawn]),
            color=merged(self.color, np.concatenate([colors[drawn] * left, left], axis=1)),
            ids=merged(self.ids, ids[columns][:, drawn].T) if columns else self.ids,
        )
