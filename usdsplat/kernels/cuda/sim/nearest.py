"""The nearest points, as `kernels.sim.nearest`: the same to the bit."""

from usdsplat.kernels.cuda.exact import uncontracted
from usdsplat.kernels.sim import nearest as loops

nearest = uncontracted(loops.nearest)
