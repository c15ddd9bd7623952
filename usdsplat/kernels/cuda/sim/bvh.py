"""Closest triangles and hits of rays, as `kernels.sim.bvh`: decisions are the CPU's.

A contracted product would give an edge other bits from either side, through which rays slip, and
triangles without area one that they may hit.
"""

from usdsplat.kernels.cuda.exact import uncontracted
from usdsplat.kernels.sim import bvh

find_closest = uncontracted(bvh.find_closest)
find_hits = uncontracted(bvh.find_hits)
