"""Light receivers on a GPU, with one thread for each."""

from __future__ import annotations

from typing import Any

from usdsplat.kernels.cuda.device import CudaDevice, form_of
from usdsplat.kernels.light_lanes import NO_THROUGH
from usdsplat.kernels.lighting import illuminate


def shine(device: CudaDevice, *args: Any) -> None:
    """Add the light of one sample to receivers, see `kernels.light_lanes.shine`."""
    *given, _, sums = args
    launch = form_of(illuminate)
    assert launch is not None
    launch(device, *given, device.keep(NO_THROUGH), sums)
