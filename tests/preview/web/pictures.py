"""Artificial pictures, without a renderer."""

from __future__ import annotations

from typing import Any

import numpy as np

from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.values import Picture, ViewState
from usdsplat.render.specs import CameraSpec


def camera() -> CameraSpec:
    """One that sees something."""
    return FreeCamera().spec(aspect=1.5, bounds=None)


def picture(*, number: int = 1, is_final: bool = True, **others: Any) -> Picture:
    """A gradient with a hard edge, 48 by 32."""
    image = np.zeros((32, 48, 3), np.uint8)
    image[..., 0] = np.arange(48) * 5
    image[..., 1] = np.arange(32)[:, None] * 8
    image[10:20, 10:30, 2] = 255
    values = {"state": ViewState(size=(48, 32)), "camera": camera(), "image": image}
    return Picture(number=number, is_final=is_final, **{**values, **others})


def scenery(*, number: int = 1, is_final: bool = True, width: int = 480) -> Picture:
    """Blobs of many sizes and colours over a gradient, as splats are; three by two."""
    random = np.random.default_rng(5)
    height = 2 * width // 3
    image = np.zeros((height, width, 3))
    image[..., 2] = np.linspace(60, 120, height)[:, None]
    for _ in range(500):
        x, y = random.integers(0, (width, height))
        deviation = width * random.uniform(0.002, 0.012)
        reach = int(3 * deviation) + 1
        rows, columns = slice(max(y - reach, 0), y + reach), slice(max(x - reach, 0), x + reach)
        part = image[rows, columns]
        down, right = np.mgrid[rows, columns][:, : part.shape[0], : part.shape[1]]
        apart = ((down - y) ** 2 + (right - x) ** 2) / deviation**2
        cover = random.uniform(0.3, 0.9) * np.exp(-0.5 * apart)[..., None]
        part += cover * (random.uniform(0, 255, 3) - part)
    return picture(
        number=number,
        is_final=is_final,
        image=image.astype(np.uint8),
        state=ViewState(size=(width, height), is_moving=not is_final),
    )
