"""Ray hits on a GPU: a thread for each splat of a block."""

from __future__ import annotations

from usdsplat.kernels import ray_hit as host
from usdsplat.kernels.cuda.device import spread

ray_hits = spread(host.ray_hits)
