"""Compare pictures of a node with those of the leaves below it, at pixels of a given size."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, FieldSpec, Framing, InstanceSpec, View

GOOD = 40.0
"""Peak signal-to-noise ratio of a good picture of a node [dB]."""
SAMPLES = 4
"""Samples of a pixel along an axis."""
EDGE = 96
"""Largest edge of the pictures [pixel]."""
LEAST_EDGE = 8
"""Smallest edge of the pictures [pixel]; silhouettes are most of smaller ones."""
WITHIN = 0.95
"""Part of the splats around the middle of a node that is in its pictures, if they are not EDGE
pixels wide."""
SMALLEST = 0.25
"""Smallest error, relative to the typical size of the proxies."""
NEARLY = 1.0
"""Difference from the best picture that counts as none [dB]."""

_SEEN = 1 / 255
_DIRECTIONS = ((0.6, 0.48, 0.64), (-0.8, 0.36, 0.48))  # from which nodes are seen
_SETTINGS = RenderSettings(sorting="zDepth", color_mode="display", rasterize_mode="antialiased")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pair:
    """The splats of a node, and those of the leaves that they stand for."""

    node: SplatCloud
    leaves: SplatCloud


class Comparison:
    """Comparison of pictures of nodes on one device."""

    def __init__(self, device: Device) -> None:
        self._renderer = Renderer(device)

    def error(self, pair: Pair, size: float) -> float:
        """Return the size of a pixel [unit] from which on the picture of a node is good.

        If no picture is good, because merging has changed the mean of the node, it is the smallest
        pixel at which the picture is within NEARLY of the best.

        Args:
            pair: The splats.
            size: Typical size of the proxies [unit], > 0. The result is at least SMALLEST times as
                large, and at most such that the picture is LEAST_EDGE pixels wide.
        """
        scenes = _scene(pair.node), _scene(pair.leaves)
        middle = np.median(pair.leaves.positions.astype(np.float64), axis=0)
        distances = np.linalg.norm(pair.leaves.positions - middle, axis=1)
        reach = max(float(np.quantile(distances, WITHIN)), 0.5 * LEAST_EDGE * size)

        def quality(ratio: float) -> float:
            edge = min(EDGE, math.ceil(2 * reach / (ratio * size)))
            return self._psnr(*scenes, list(_views(middle, reach, ratio * size, edge)))

        ratios, found = [1.0], [quality(1.0)]
        while found[0] >= GOOD and ratios[0] > SMALLEST:
            ratios.insert(0, 0.5 * ratios[0])
            found.insert(0, quality(ratios[0]))
        while max(found) < GOOD and 2 * reach / (2 * ratios[-1] * size) >= LEAST_EDGE:
            ratios.append(2 * ratios[-1])
            found.append(quality(ratios[-1]))
        first = next((k for k, each in enumerate(found) if each >= GOOD), None)
        if first is None:
            best = max(found)
            return size * next(r for r, f in zip(ratios, found, strict=True) if f >= best - NEARLY)
        if first == 0:
            return size * ratios[0]
        part = (GOOD - found[first - 1]) / (found[first] - found[first - 1])
        return float(size * ratios[first - 1] * 2**part)

    def _psnr(self, found: RenderScene, expected: RenderScene, views: list[View]) -> float:
        """Return the peak signal-to-noise ratio [dB] over the pixels that are seen."""
        squares, count = 0.0, 0
        for view in views:
            picture, truth = self._picture(found, view), self._picture(expected, view)
            seen = truth[..., 3] > _SEEN
            squares += float(
                np.square(picture[seen][:, :3].astype(np.float64) - truth[seen][:, :3]).sum()
            )
            count += 3 * int(np.count_nonzero(seen))
        return math.inf if squares == 0 else -10 * math.log10(squares / count)

    def _picture(self, scene: RenderScene, view: View) -> F32:
        """Return a picture, the mean of SAMPLES x SAMPLES samples of each pixel."""
        bands = self._renderer.render(scene, view, _SETTINGS, ("color",))
        fine = np.concatenate([band.arrays["color"].copy() for band in bands])
        height, width, channels = fine.shape
        shape = (height // SAMPLES, SAMPLES, width // SAMPLES, SAMPLES, channels)
        return fine.reshape(shape).mean(axis=(1, 3))


def _scene(cloud: SplatCloud) -> RenderScene:
    """Return a scene with splats."""
    scene = RenderScene()
    scene.set_field("/node", FieldSpec(cloud=cloud, rasterize_mode="antialiased"))
    scene.set_instances("/node", (InstanceSpec(path="/node"),))
    return scene


def _views(middle: F64, reach: float, pixel: float, edge: int) -> Iterator[View]:
    """Yield orthographic views of a point, `edge` pixels of the size `pixel` [unit] wide."""
    half = 0.5 * edge * pixel
    for direction in _DIRECTIONS:
        back = np.array(direction) / np.linalg.norm(direction)
        right = np.cross([0.0, 1.0, 0.0], back)
        right /= np.linalg.norm(right)
        axes = np.array([right, np.cross(back, right), back])
        away = 4 * (reach + half)
        matrix = np.eye(4)
        matrix[:3, :3] = axes
        matrix[:3, 3] = -axes @ (middle + back * away)
        camera = CameraSpec(
            world_to_camera=tuple(map(float, matrix.ravel())),
            orthographic=True,
            window=(-half, -half, half, half),
            clipping_range=(1e-3 * away, 1e3 * away),
        )
        size = SAMPLES * edge
        yield View(camera=camera, framing=Framing(resolution=(size, size)))
