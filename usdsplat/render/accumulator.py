"""Average the samples of a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.images.aovs import is_light
from usdsplat.images.cryptomatte import LAYERS, object_hash, rank_pairs
from usdsplat.kernels import cryptomatte, total
from usdsplat.kernels.device import Device
from usdsplat.render.aov_resolver import SplatLayers
from usdsplat.render.frame_buffers import MatteBuffers
from usdsplat.render.frame_context import FrameContext
from usdsplat.render.matte_groups import MatteGroups


class SampleAccumulator:
    """Weighted averages of the samples of one band.

    Args:
        shape: Rows and columns.
        names: The AOVs to average: color, albedo, those of light, layers of Cryptomatte.
    """

    def __init__(self, frame: FrameContext, shape: tuple[int, int], names: Sequence[str]) -> None:
        self._device = frame.device
        self._count = self._matte_count = 0
        held = frame.buffers.sums
        whole = {
            "color": held.color, "albedo": held.albedo, "shadow": held.shadow,
            "irradiance": held.irradiance,
        }  # fmt: skip
        self._sums = {name: whole[name](*shape) for name in names if name in whole}
        parts = tuple(filter(is_light, names))
        lights = held.lights(len(parts), *shape)
        for k, name in enumerate(parts):
            self._sums[name] = lights[k * shape[0] : (k + 1) * shape[0]]
        for each in self._sums.values():
            frame.device.run(total.clear, each)
        pairs = rank_pairs(frame.settings.crypto_rank)
        self._mattes = {
            layer: _Mattes(frame.device, frame.buffers.matte(layer), (*shape, pairs))
            for layer in LAYERS
            if layer in names
        }

    def add(self, arrays: Mapping[str, Any], groups: Mapping[str, MatteGroups]) -> None:
        """Add one sample.

        Args:
            arrays: AOV -> pixels; of layers of Cryptomatte lists of (groups, weights).
            groups: Layer of Cryptomatte -> the groups of this sample.
        """
        self.add_images(arrays)
        self.add_mattes(arrays, groups)

    def add_images(self, arrays: Mapping[str, Any]) -> None:
        """Add colour, albedo and AOVs of light of one sample."""
        self._count += 1
        for name, held in self._sums.items():
            self._device.run(total.add, held, arrays[name])

    def add_mattes(self, arrays: Mapping[str, Any], groups: Mapping[str, MatteGroups]) -> None:
        """Add the layers of Cryptomatte of one sample."""
        self._matte_count += 1
        for layer, mattes in self._mattes.items():
            mattes.add(arrays[layer], groups[layer].names)

    def finish(self) -> dict[str, npt.NDArray[Any]]:
        """Return the averages as arrays of the device."""
        scale = np.float32(1 / self._count)
        matte_scale = np.float32(1 / max(1, self._matte_count))  # none on the fused path
        for each in self._sums.values():
            self._device.run(total.scale, each, scale)
        ranked = {layer: mattes.ranked(matte_scale) for layer, mattes in self._mattes.items()}
        return {**self._sums, **ranked}


class LayerAverage:
    """Mean of the splat layers of samples that share their surfaces, in the blend space.

    Coarse levels of splat trees stand for splats that are blended in that space. Their samples must
    be averaged there too, unlike those of shutter and lens, which average light.
    """

    def __init__(self, frame: FrameContext, shape: tuple[int, int]) -> None:
        self._device, self._shape = frame.device, shape
        self._buffers = frame.buffers.layers
        self._sums: dict[str, npt.NDArray[Any]] = {}
        self._count = 0

    def add(self, layers: SplatLayers) -> None:
        """Add the layers of one sample."""
        self._count += 1
        for name, array in (
            ("color", layers.color),
            ("albedo", layers.albedo),
            ("left", layers.left),
            ("lights", layers.lights),
        ):
            if array is None:
                continue
            if name not in self._sums:
                parts = (array.shape[0] // self._shape[0],) if name == "lights" else ()
                self._sums[name] = getattr(self._buffers, name)(*parts, *self._shape)
                self._device.run(total.clear, _with_channels(self._sums[name]))
            self._device.run(total.add, _with_channels(self._sums[name]), _with_channels(array))

    def finish(self) -> SplatLayers:
        """Return the means as arrays of the device."""
        scale = np.float32(1 / self._count)
        for each in self._sums.values():
            self._device.run(total.scale, _with_channels(each), scale)
        return SplatLayers(
            color=self._sums["color"],
            albedo=self._sums.get("albedo"),
            left=self._sums.get("left"),
            lights=self._sums.get("lights"),
        )


def _with_channels(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an image with an axis of channels."""
    return image if image.ndim == 3 else image.reshape((*image.shape, 1))


class _Mattes:
    """Sums of one layer of Cryptomatte.

    Args:
        shape: Rows, columns, and groups of four channels.
    """

    def __init__(self, device: Device, buffers: MatteBuffers, shape: tuple[int, int, int]) -> None:
        self._device = device
        self._numbers: dict[str, int] = {}
        """Name -> number of each group, in the order of first appearance."""
        self._groups, self._weights = buffers.all_prims(*shape), buffers.all_weights(*shape)
        self._ranked = buffers.ranked(*shape)
        device.run(cryptomatte.begin, self._groups, self._weights)

    def add(self, found: Sequence[tuple[Any, Any]], names: Sequence[str]) -> None:
        """Add the (groups, weights) of one sample, whose group numbers index `names`."""
        table = [self._numbers.setdefault(name, len(self._numbers)) for name in names]
        numbers = self._device.upload(np.array(table, np.int32))
        for groups, weights in found:
            self._device.run(
                cryptomatte.gather, groups, weights, numbers, self._groups, self._weights
            )

    def ranked(self, scale: np.float32) -> npt.NDArray[Any]:
        """Return the channels, with weights multiplied by `scale`."""
        hashes = np.array([object_hash(name) for name in self._numbers], np.float32)
        self._device.run(
            cryptomatte.finish, self._groups, self._weights, scale, self._device.upload(hashes),
            self._ranked,
        )  # fmt: skip
        return self._ranked
