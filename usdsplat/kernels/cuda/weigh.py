"""Weigh the prims of each pixel on a GPU, in the order of the lists."""

from __future__ import annotations

from typing import Any

import numpy as np

from usdsplat.kernels.cuda import walk as any_order
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.walk import WEIGH

NOTHING: dict[str, Any] = {
    "keeps": np.empty(0, np.float32),
    "covered": np.empty((0, 0), np.uint8),
    "offsets": np.empty(0, np.int64),
    "numbers": np.empty(0, np.float32),
    "image": np.empty((0, 0, 4), np.float32),
    "plane": np.empty((0, 0), np.float32),
    "places": np.empty((0, 0), np.int32),
    "counts": np.empty((0, 0), np.uint32),
    "colors": np.empty((0, 4), np.float32),
}
"""Arguments of `walk` that are not used to weigh prims."""


def weigh(
    device: CudaDevice, records: Any, labels: Any, prims: int, starts: Any, lists: Any, grid: Any,
    ray_hits: Any, occluder_depth: Any, is_parallel: bool, ids: Any, weights: Any,
) -> None:  # fmt: skip
    """Weigh prims, see `kernels.weigh.weigh`."""
    options = WEIGH, False, is_parallel, prims, np.float32(0), np.float32(0)
    no = {name: device.keep(array) for name, array in NOTHING.items()}
    samples = no["numbers"], no["numbers"], no["colors"]
    image, nearest = no["image"], (no["places"], no["plane"])
    out = (
        image, image, image, image, image, no["plane"], nearest, nearest, (ids, weights),
        no["counts"], no["offsets"], samples,
    )  # fmt: skip
    any_order.walk_pixels(
        device, options, records, records, no["keeps"], labels, starts, lists, grid,
        ray_hits, occluder_depth, no["covered"], (no["offsets"], no["numbers"], no["numbers"]), out,
    )  # fmt: skip
