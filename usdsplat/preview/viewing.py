"""Display transforms: the tables of `kernels.show` for a view, an exposure and a gamma.

Exposure and gamma of a plain view are one curve. An OCIO view is sampled once into a lattice,
because OpenImageIO takes a second for a viewport; it is within a code value or two of the view
itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.images.color import conversion, convert, is_identity
from usdsplat.images.view import CAPTURE_SPACE, ViewTransform
from usdsplat.render.output import view_of
from usdsplat.render.settings import RenderSettings

STEPS = 16384
"""Number of entries of a curve."""
NODES = 65
"""Number of lattice nodes along each axis."""
BRIGHTEST = 100.0
"""Linear value at the lattice's end; views are white long before."""
TOE = 500.0
"""Scale of the lattice's logarithm: it is about linear below 1 / TOE."""

NO_TABLE: F32 = np.empty(0, np.float32)
NO_MATRIX: F32 = np.empty((0, 3), np.float32)
NO_CUBE: F32 = np.empty((0, 0, 0, 3), np.float32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DisplayTransform:
    """Colour transform from a picture to the screen, as `kernels.show.show` takes it."""

    matrix: F32 = field(default_factory=lambda: NO_MATRIX)
    shaper: F32 = field(default_factory=lambda: NO_TABLE)
    shaper_top: float = BRIGHTEST
    """Linear value at which the shaper's table ends."""
    cube: F32 = field(default_factory=lambda: NO_CUBE)
    table: F32 = field(default_factory=lambda: NO_TABLE)
    top: float = 1.0
    """Argument at which the last curve's table ends."""


class DisplayTransforms:
    """Makes display transforms; the last one and its lattice are cached."""

    def __init__(self) -> None:
        self._key: tuple[RenderSettings, float, float] | None = None
        self._transform = DisplayTransform()
        self._sampled: tuple[ViewTransform, F32] | None = None

    def of(self, settings: RenderSettings, *, exposure: float, gamma: float) -> DisplayTransform:
        """Return the display transform of a picture drawn by `settings`.

        Raises:
            UsageError: If there is no such OCIO view.
        """
        key = settings, exposure, gamma
        if key != self._key:
            self._transform = self._made(*key)
            self._key = key
        return self._transform

    def _made(self, settings: RenderSettings, exposure: float, gamma: float) -> DisplayTransform:
        gain = 2.0**exposure
        if settings.color_mode in ("auto", "display"):
            if gain == gamma == 1.0:
                return DisplayTransform()
            top = max(float(_encoded(1.0 / gain)), 1e-6)
            curve = _encoded(gain * _decoded(_squares(top)))
            return DisplayTransform(table=_as_table(curve, gamma), top=top)
        view = view_of(settings)
        if view.is_plain:
            numbers = conversion(settings.working_space, "lin_rec709_scene")
            matrix = np.eye(3) if is_identity(numbers) else numbers[2:11].reshape(3, 3)
            return DisplayTransform(
                matrix=(gain * matrix).astype(np.float32),
                table=_as_table(_encoded(_squares(1.0)), gamma),
            )
        return DisplayTransform(
            matrix=(gain * np.eye(3)).astype(np.float32),
            shaper=_shaped(_squares(BRIGHTEST)).astype(np.float32),
            cube=self._lattice(view),
            table=NO_TABLE if gamma == 1.0 else _as_table(_squares(1.0), gamma),
        )

    def _lattice(self, view: ViewTransform) -> F32:
        if self._sampled is None or self._sampled[0] != view:
            part = np.linspace(0.0, 1.0, NODES)
            linear = np.expm1(part * np.log1p(TOE * BRIGHTEST)) / TOE
            nodes = np.stack(np.meshgrid(linear, linear, linear, indexing="ij"), axis=-1)
            rows = nodes.reshape(NODES, -1, 3).astype(np.float32)
            shown = view.forward(rows).reshape(NODES, NODES, NODES, 3)
            self._sampled = view, np.ascontiguousarray(shown, np.float32)
        return self._sampled[1]


def _squares(top: float) -> F64:
    """Return the arguments of the entries of a table that ends at `top`."""
    part: F64 = np.linspace(0.0, 1.0, STEPS)
    return top * part**2


def _shaped(linear: F64) -> F64:
    """Return the lattice coordinates of linear values [0..1]."""
    return np.asarray(np.log1p(TOE * linear) / np.log1p(TOE * BRIGHTEST))


def _as_table(codes: F64, gamma: float) -> F32:
    return (np.clip(codes, 0.0, 1.0) ** (1.0 / gamma)).astype(np.float32)


def _through(source: str, target: str, values: F64 | float) -> F64:
    """Convert grey values from one Rec.709 space to another."""
    grey = np.repeat(np.asarray(values, np.float64)[..., None], 3, axis=-1)
    return convert(grey, source, target)[..., 0]


_encoded = partial(_through, "lin_rec709_scene", CAPTURE_SPACE)
_decoded = partial(_through, CAPTURE_SPACE, "lin_rec709_scene")
