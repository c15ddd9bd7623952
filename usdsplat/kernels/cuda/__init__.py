"""Run kernels on NVIDIA GPUs.

`device` runs a kernel in one of these forms:

- A `launch.Kernel`, a function of one item, has a loop for GPUs too, see `loops`.
- A kernel over tiles, or in steps, names the function that a GPU runs in its place:
  `parallel(writes=..., gpu="blend.blend")` in `kernels.blend` is `kernels.cuda.blend.blend`. It is
  called with the device and the kernel's arguments.
- Any other kernel is serial. The CPU runs it, on copies of the arrays.

`frame` draws a whole colour picture without returning to the host in between.
"""

import numpy as np

if not hasattr(np, "row_stack"):  # NumPy 2.5 has dropped the name that numba-cuda 0.30 imports
    vars(np)["row_stack"] = np.vstack
