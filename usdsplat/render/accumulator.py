"""Average the samples of a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.images.cryptomatte import object_hash
from usdsplat.kernels import cryptomatte, total
from usdsplat.kernels.device import Device
from usdsplat.render.frame_buffers import SumBuffers


class SampleAccumulator:
    """Weighted averages of the samples of one band.

    Args:
        shape: Rows and columns.
        names: The AOVs to average: color, albedo, cryptoObject.
    """

    def __init__(
        self, device: Device, buffers: SumBuffers, shape: tuple[int, int], names: Sequence[str]
    ) -> None:
        self._device = device
        self._names = names
        self._count = 0
        self._prims: dict[str, int] = {}
        """Path -> number of each prim, in the order of first appearance."""
        self._sums: dict[str, npt.NDArray[Any]] = {}
        sums = {"color": buffers.color, "albedo": buffers.albedo}
        for name in names:
            if name in sums:
                self._sums[name] = sums[name](*shape)
                device.run(total.clear, self._sums[name])
        if "cryptoObject" in names:
            self._ids = buffers.prims(*shape)
            self._weights = buffers.weights(*shape)
            device.run(cryptomatte.begin, self._ids, self._weights)
            self._mattes = buffers.mattes(*shape)

    def add(self, arrays: Mapping[str, Any], prims: Sequence[str]) -> None:
        """Add one sample.

        Args:
            arrays: AOV -> pixels; cryptoObject is a list of (prims, weights).
            prims: Path of each prim; the sample's prim numbers index this list.
        """
        self._count += 1
        run = self._device.run
        table = [self._prims.setdefault(path, len(self._prims)) for path in prims]
        numbers = self._device.upload(np.array(table, np.int32))
        for name in self._names:
            if name in self._sums:
                run(total.add, self._sums[name], arrays[name])
            else:
                for ids, weights in arrays[name]:
                    run(cryptomatte.gather, ids, weights, numbers, self._ids, self._weights)

    def finish(self) -> dict[str, npt.NDArray[Any]]:
        """Return the averages as arrays of the device."""
        run, scale = self._device.run, np.float32(1 / self._count)
        for each in self._sums.values():
            run(total.scale, each, scale)
        if "cryptoObject" not in self._names:
            return dict(self._sums)
        hashes = np.array([object_hash(path) for path in self._prims], np.float32)
        run(
            cryptomatte.finish, self._ids, self._weights, scale, self._device.upload(hashes),
            self._mattes,
        )  # fmt: skip
        return {**self._sums, "cryptoObject": self._mattes}
