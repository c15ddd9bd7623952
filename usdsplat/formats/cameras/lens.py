"""Lens models of photographs: COLMAP's models with OpenCV's names for the coefficients.

Source: COLMAP's camera models, doc/cameras.rst and the parameter lists beside each model; OpenCV's
camera calibration for the polynomials.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from usdsplat.core.errors import FormatError

MODELS: Mapping[str, tuple[int, str]] = {
    "SIMPLE_PINHOLE": (0, "f cx cy"),
    "PINHOLE": (1, "fx fy cx cy"),
    "SIMPLE_RADIAL": (2, "f cx cy k1"),
    "RADIAL": (3, "f cx cy k1 k2"),
    "OPENCV": (4, "fx fy cx cy k1 k2 p1 p2"),
    "OPENCV_FISHEYE": (5, "fx fy cx cy k1 k2 k3 k4"),
    "FULL_OPENCV": (6, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "FOV": (7, "fx fy cx cy omega"),
    "SIMPLE_RADIAL_FISHEYE": (8, "f cx cy k1"),
    "RADIAL_FISHEYE": (9, "f cx cy k1 k2"),
    "THIN_PRISM_FISHEYE": (10, "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"),
    "SIMPLE_DIVISION": (12, "f cx cy k"),
    "DIVISION": (13, "fx fy cx cy k"),
    "SIMPLE_FISHEYE": (14, "f cx cy"),
    "FISHEYE": (15, "fx fy cx cy"),
    "EUCM": (16, "fx fy cx cy alpha beta"),
}
"""Model name -> (number in binary files, names of its parameters)."""

FLAT = {"SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"}
"""Perspective models: straight lines stay straight except for the polynomial distortion."""
ANGULAR = {
    *("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_FISHEYE", "FISHEYE"),
}
"""Fisheye models: the distance from the image centre is a function of the viewing angle."""

_LARGEST_SIDE = 1 << 20
_FOCAL = ("f", "fx", "fy")
_CENTRE = ("cx", "cy")


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """Intrinsics of a photograph. Pixel (0, 0) has its centre at (0.5, 0.5), x right and y down."""

    model: str
    """One of `MODELS`."""
    width: int
    height: int
    """Size of the photograph [pixel]."""
    fx: float
    fy: float
    """Focal lengths [pixel]."""
    cx: float
    cy: float
    """Principal point [pixel]."""
    distortion: Mapping[str, float] = field(default_factory=dict)
    """Coefficient -> value, nonzero ones only."""

    @property
    def is_pinhole(self) -> bool:
        """Whether the lens is a pinhole: perspective projection without distortion."""
        return self.model in FLAT and not self.distortion

    @property
    def displacement(self) -> float | None:
        """Largest displacement from a pinhole projection at the corners, the middles of the sides
        and the centre [pixel]; None if it is unknown or infinite."""
        if self.model not in FLAT | ANGULAR:
            return None
        columns, rows = (0.0, self.width / 2, self.width), (0.0, self.height / 2, self.height)
        offsets = (self._offset(u, v) for u in columns for v in rows)
        largest = max(offsets)
        return largest if math.isfinite(largest) else None

    def _offset(self, u: float, v: float) -> float:
        """Return the displacement of the point that a pinhole projects to (u, v) [pixel]."""
        x, y = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        bent = _fisheye if self.model in ANGULAR else _polynomial
        try:
            bent_x, bent_y = bent(x, y, self.distortion)
        except (OverflowError, ZeroDivisionError):
            return math.inf
        return math.hypot(self.fx * (bent_x - x), self.fy * (bent_y - y))


def lens(where: str, model: str, size: tuple[int, int], values: Sequence[float]) -> Lens:
    """Make a lens from the parameters of its model, in their order.

    Args:
        where: Name of the lens in error messages.
        size: Width and height [pixel].

    Raises:
        FormatError: If the model is unknown, the number of parameters is wrong, or a parameter or a
            side has an impossible value.
    """
    if model not in MODELS:
        raise FormatError(where, f"camera model {model[:40]!r}", f"one of {', '.join(MODELS)}")
    names = MODELS[model][1].split()
    if len(values) != len(names):
        found = f"{len(values)} parameters of {model}"
        raise FormatError(where, found, f"{len(names)}: {' '.join(names)}")
    given = dict(zip(names, values, strict=True))
    if not all(0 < side <= _LARGEST_SIDE for side in size):
        expected = f"sides from 1 to {_LARGEST_SIDE} pixels"
        raise FormatError(where, f"a picture of {size[0]} x {size[1]}", expected)
    for name, value in given.items():
        if not math.isfinite(value) or (name in _FOCAL and not 1e-6 < value < 1e12):
            expected = "a positive number of pixels" if name in _FOCAL else "a finite number"
            raise FormatError(f"{where}: {name}", f"{value:g}", expected)
    return Lens(
        model=model,
        width=size[0],
        height=size[1],
        fx=given.get("fx", given.get("f", math.nan)),
        fy=given.get("fy", given.get("f", math.nan)),
        cx=given["cx"],
        cy=given["cy"],
        distortion={
            name: value
            for name, value in given.items()
            if name not in (*_FOCAL, *_CENTRE) and value
        },
    )


def _polynomial(x: float, y: float, of: Mapping[str, float]) -> tuple[float, float]:
    """Apply radial, rational and tangential distortion to a point on the plane at distance 1."""
    k1, k2, k3, k4, k5, k6 = (of.get(f"k{i}", 0.0) for i in range(1, 7))
    p1, p2 = of.get("p1", 0.0), of.get("p2", 0.0)
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
    )


def _fisheye(x: float, y: float, of: Mapping[str, float]) -> tuple[float, float]:
    """Apply fisheye distortion, a polynomial in the angle, to a point on the plane at distance
    1."""
    k1, k2, k3, k4 = (of.get(f"k{i}", 0.0) for i in range(1, 5))
    r = math.hypot(x, y)
    if r == 0:
        return x, y
    angle = math.atan(r)
    t2 = angle * angle
    bent = angle * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    return x * bent / r, y * bent / r
