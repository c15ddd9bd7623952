"""Convert splat layers and shaded surfaces to the colour space of the picture."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.images.color import conversion, is_identity
from usdsplat.images.view import ViewTransform, open_view
from usdsplat.kernels import recolor
from usdsplat.kernels.device import Device
from usdsplat.render.settings import RenderSettings

DISPLAY_SPACE, SURFACE_SPACE = "srgb_rec709_scene", "lin_rec709_scene"
LINEAR_MATRIX = slice(2, 11)
"""Indices of the linear 3x3 matrix in the numbers of a `conversion`."""


class Output:
    """Conversion of the two layers of a picture for one colour mode.

    In `display`, splats are unchanged and surfaces are converted by the view. In `scene`, both are
    converted to the working space. In `inverseView`, splats are converted to it by the inverse of
    the view. Exposure applies to all light in the working space.

    Args:
        settings: Settings whose colour mode is not auto.
        blend_space: Colour space in which splats are blended.
        exposure: Linear exposure factor of the camera.

    Raises:
        UsageError: If the OCIO view does not exist.
    """

    def __init__(
        self, device: Device, settings: RenderSettings, blend_space: str, exposure: float
    ) -> None:
        self._device = device
        self._mode = settings.color_mode
        self._most = settings.inverse_max
        self._view = view_of(settings)
        self._exposure = exposure
        working = settings.working_space
        target = working if self._mode == "scene" else DISPLAY_SPACE
        self._splats = conversion(blend_space, target)
        if self._mode == "scene":
            self._splats[LINEAR_MATRIX] *= np.float32(exposure)
        plain = self._mode == "display" and self._view.is_plain
        self._surfaces = conversion(SURFACE_SPACE, DISPLAY_SPACE if plain else working)
        self._surfaces[LINEAR_MATRIX] *= np.float32(exposure)
        self._light = conversion(SURFACE_SPACE, working)
        self.failed = 0
        """Number of pixels so far whose captured colour the view cannot produce."""
        self.covered = 0
        """Number of pixels with splats so far. Both are counted in `inverseView` only."""

    def splats(self, image: F32, *, counts: bool = True) -> F32:
        """Return a splat layer, premultiplied, shape (h, w, 4), in the picture's space.

        `counts` says whether its pixels are added to `failed` and `covered`. The layer is copied to
        the host only for a view.
        """
        self._recolor(image, self._splats)
        if self._mode != "inverseView":
            return image
        image = self._device.fetch(image)
        linear, failed = self._view.inverse_over(image, most=self._most)
        if counts:
            self.failed += int(failed.sum())
            self.covered += int((image[..., 3] > 0).sum())
        if self._exposure != 1.0:
            linear[..., :3] *= np.float32(self._exposure)
        return linear

    def surfaces(self, rgb: F32) -> F32:
        """Return shaded surfaces, linear Rec.709, shape (h, w, 3), in the picture's space."""
        self._recolor(rgb, self._surfaces)
        if self._mode == "display" and not self._view.is_plain:
            return self._view.forward(self._device.fetch(rgb))
        return rgb

    def light(self, rgb: F32) -> F32:
        """Return light, linear Rec.709, shape (h, w, 3), in the working space, without exposure."""
        self._recolor(rgb, self._light)
        return rgb

    def _recolor(self, image: F32, numbers: F32) -> None:
        if not is_identity(numbers):
            self._device.run(recolor.recolor, image, numbers)


def view_of(settings: RenderSettings) -> ViewTransform:
    """Open the OCIO view that the settings name.

    Raises:
        UsageError: If it does not exist.
    """
    return open_view(
        config=settings.ocio_config,
        display=settings.ocio_display,
        view=settings.ocio_view,
        look=settings.ocio_look,
        working_space=settings.working_space,
    )
