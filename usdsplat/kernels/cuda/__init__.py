"""The kernels on an NVIDIA GPU: the same arrays in and out, the same scalar mathematics.

`device` is the door. It runs a kernel in the first of these forms that there is:

- written for it: the function of the same name in the same place under this folder, such as
  `cuda.blend.blend` for `kernels.blend.blend`. It takes the device, then the kernel's arguments.
- derived: a kernel that is one `prange` loop, whose items become threads, see `derive`.
- the CPU's, on copies: what is serial by nature, and done once.

`frame` is a whole picture without the host in between.
"""
