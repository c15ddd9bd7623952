"""Compare pictures of a node, and of its children, with the mean of the leaves below it.

A node may take the place of its children where its picture is as good as theirs. Both are therefore
drawn as pictures draw them: leaves with one sample a pixel and their own low-pass, which makes a
classic capture too dense from afar, and proxies with a few samples. Children that look worse than
the node are no reason to refine it, however good or bad its own picture is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, FieldSpec, Framing, InstanceSpec, RasterizeMode, View

GOOD = 40.0
"""Peak signal-to-noise ratio of a picture that need not be better [dB]."""
SAMPLES = 4
"""Samples of a pixel of the mean along an axis."""
EDGE = 96
"""Largest edge of the pictures [pixel]."""
LEAST_EDGE = 8
"""Smallest edge of the pictures [pixel]; silhouettes are most of smaller ones."""
WITHIN = 0.95
"""Part of the splats around the middle of a node that is in its pictures, if they are not EDGE
pixels wide."""
SMALLEST = 1 / 16
"""Smallest error, relative to the typical size of the proxies."""
NEARLY = 1.0
"""Difference of two pictures that counts as none [dB]."""

_SEEN = 1 / 255
_DIRECTIONS = ((0.6, 0.48, 0.64), (-0.8, 0.36, 0.48))  # from which nodes are seen
_SETTINGS = RenderSettings(sorting="zDepth", color_mode="display")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pair:
    """The splats of a node, and what is drawn if it is refined."""

    node: SplatCloud
    """Proxies and residents."""
    proxies: SplatCloud
    """Proxies of its children."""
    captured: SplatCloud
    """Its residents, and the splats of the capture of its children."""
    captured_mode: RasterizeMode
    """How pictures draw splats of the capture."""
    leaves: SplatCloud
    """Splats of all leaves below, with the low-pass baked, whose mean is right."""


class Comparison:
    """Comparison of pictures of nodes on one device."""

    def __init__(self, device: Device) -> None:
        self._renderer = Renderer(device)

    def error(self, pair: Pair, size: float, least: float = 0.0) -> float:
        """Return the smallest pixel [unit] at which the picture of a node is good, or within NEARLY
        of that of its children.

        If there is none, because merging has changed the mean of the node, it is the smallest pixel
        at which the picture of the node is within NEARLY of its best.

        Args:
            pair: The splats.
            size: Typical size of the proxies [unit], > 0. The result is at least SMALLEST times as
                large. Larger pixels are tried while a picture is at least LEAST_EDGE pixels wide.
            least: Smallest result [unit], >= 0.
        """
        leaves = _scene((pair.leaves, "antialiased"))
        node = _scene((pair.node, "antialiased"))
        children = _scene((pair.captured, pair.captured_mode), (pair.proxies, "antialiased"))
        of_children = _SETTINGS.lod_samples if len(pair.proxies) else 1
        middle = np.median(pair.leaves.positions.astype(np.float64), axis=0)
        distances = np.linalg.norm(pair.leaves.positions - middle, axis=1)
        reach = max(float(np.quantile(distances, WITHIN)), 0.5 * LEAST_EDGE * size)

        def quality(pixel: float) -> tuple[float, float]:
            """Return the qualities of the node and of its children [dB]."""
            edge = min(EDGE, math.ceil(2 * reach / pixel))
            views = list(_views(middle, reach, pixel, edge))
            truth = [self._picture(leaves, view, SAMPLES) for view in views]
            return (
                self._psnr(node, views, truth, _SETTINGS.lod_samples),
                self._psnr(children, views, truth, of_children),
            )

        pixels: list[float] = []
        found: list[float] = []
        excess: list[float] = []
        pixel = max(least, SMALLEST * size)
        while not pixels or 2 * reach / pixel >= LEAST_EDGE:
            here, there = quality(pixel)
            pixels.append(pixel)
            found.append(here)
            excess.append(here - min(GOOD, there - NEARLY))
            if excess[-1] >= 0:
                if len(pixels) == 1:
                    return pixel
                part = excess[-2] / (excess[-2] - excess[-1])
                return float(pixels[-2] * 2**part)
            pixel *= 2
        return next(p for p, f in zip(pixels, found, strict=True) if f >= max(found) - NEARLY)

    def _psnr(self, scene: RenderScene, views: list[View], truth: list[F32], samples: int) -> float:
        """Return the peak signal-to-noise ratio [dB] over the pixels that are seen."""
        squares, count = 0.0, 0
        for view, expected in zip(views, truth, strict=True):
            picture = self._picture(scene, view, samples)
            seen = expected[..., 3] > _SEEN
            squares += float(
                np.square(picture[seen][:, :3].astype(np.float64) - expected[seen][:, :3]).sum()
            )
            count += 3 * int(np.count_nonzero(seen))
        return math.inf if squares == 0 else -10 * math.log10(squares / count)

    def _picture(self, scene: RenderScene, view: View, samples: int) -> F32:
        """Return a picture, the mean of `samples` x `samples` samples of each pixel."""
        width, height = view.framing.resolution
        fine_view = replace(view, framing=Framing(resolution=(samples * width, samples * height)))
        bands = self._renderer.render(scene, fine_view, _SETTINGS, ("color",))
        fine = np.concatenate([band.arrays["color"].copy() for band in bands])
        return fine.reshape(height, samples, width, samples, -1).mean(axis=(1, 3))


def _scene(*parts: tuple[SplatCloud, RasterizeMode]) -> RenderScene:
    """Return a scene with splats that are drawn in their modes."""
    scene = RenderScene()
    for number, (cloud, mode) in enumerate(parts):
        if len(cloud):
            path = f"/part{number}"
            scene.set_field(path, FieldSpec(cloud=cloud, rasterize_mode=mode))
            scene.set_instances(path, (InstanceSpec(path=path),))
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
        yield View(camera=camera, framing=Framing(resolution=(edge, edge)))
