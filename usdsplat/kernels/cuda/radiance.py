"""Radiance on a GPU: a thread for each splat of a block."""

from __future__ import annotations

from usdsplat.kernels import radiance as host
from usdsplat.kernels.cuda.exact import contracted_spread

radiance = contracted_spread(host.radiance)
