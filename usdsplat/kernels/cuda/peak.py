"""Peaks on a GPU: a thread for each splat of a block."""

from __future__ import annotations

from usdsplat.kernels import peak as host
from usdsplat.kernels.cuda.device import spread

peaks = spread(host.peaks)
