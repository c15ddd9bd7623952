"""Read and write our packed type, ParticleFieldPackedSplat.

USD does not interpolate integer arrays. Between time samples, this module decodes both samples and
interpolates the results, as USD does for stock arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Sdf, Usd, Vt

from usdsplat.core import quaternion
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.schema import attributes, packing, tokens
from usdsplat.schema.attributes import set_array, set_uniform
from usdsplat.schema.vt import to_vt

SLACK = packing.SCALE_ERROR + packing.ROTATION_ERROR
"""Upper bound of how much packing enlarges a splat, relative to its largest scale."""

_Type = Sdf.ValueTypeNames
_CHUNK = 1 << 14  # splats per block: temporaries stay in the cache
_EMPTY = {
    tokens.PACKED: (0, 4),
    tokens.COLOR_RANGE: (0, 3),
    tokens.PACKED_HARMONICS: (0, 4),
    tokens.HARMONICS_RANGE: (0,),
}
_FLOATS = (tokens.COLOR_RANGE, tokens.HARMONICS_RANGE)


def author(
    prim: Usd.Prim, centres: F32, arrays: packing.PackedArrays, *, code: Usd.TimeCode
) -> None:
    """Write the arrays of a packed prim and remove stock arrays from the edit target.

    Stock arrays of weaker layers remain; readers ignore them because of the type.

    Args:
        prim: Of the packed type.
        centres: Centres [scene unit], shape (n, 3).
        arrays: The other attributes of n splats.
        code: Default, or the time code of a sample.
    """
    attributes.forget(prim, {*tokens.HALF_OF, *tokens.HALF_OF.values()} - {tokens.POSITIONS})
    positions = to_vt(centres, Vt.Vec3fArray)
    set_array(prim, tokens.POSITIONS, _Type.Point3fArray, positions, code)
    author_appearance(prim, arrays, code=code)
    set_uniform(prim, tokens.PACKING, _Type.Token, packing.TOKEN)
    set_uniform(prim, tokens.SH_DEGREE, _Type.Int, arrays.degree)


def author_appearance(prim: Usd.Prim, arrays: packing.PackedArrays, *, code: Usd.TimeCode) -> None:
    """Write all packed arrays of a prim, which hold everything but the centres."""
    for name, kind, vt_kind, value in (
        (tokens.PACKED, _Type.Int4Array, Vt.Vec4iArray, arrays.core),
        (tokens.COLOR_RANGE, _Type.Float3Array, Vt.Vec3fArray, arrays.color_range),
        (tokens.PACKED_HARMONICS, _Type.Int4Array, Vt.Vec4iArray, arrays.harmonics),
        (tokens.HARMONICS_RANGE, _Type.FloatArray, Vt.FloatArray, arrays.harmonics_range),
    ):
        set_array(prim, name, kind, to_vt(value, vt_kind), code)


def fetch(prim: Usd.Prim, code: Usd.TimeCode, time: attributes.Time) -> SplatCloud:
    """Read a packed prim; interpolate between samples as the stage specifies.

    If two samples differ in count or degree, the earlier one is held, as USD does for arrays of
    different lengths.

    Args:
        prim: Of the packed type.
        code: Result of `attributes.time_code` for `time`.
        time: Requested time, to which velocities extrapolate the centres.

    Raises:
        StageError: If the layout is not one we know, or an array is missing or too short.
    """
    _check_layout(prim)
    positions, velocities = attributes.centres(prim, tokens.POSITIONS, code, time)
    n = len(positions)
    ids = attributes.ids(prim, code, n)

    def decoded(sample: Usd.TimeCode) -> SplatCloud:
        arrays = _arrays(prim, sample, n)
        return packing.unpack(positions, arrays, ids=ids, velocities=velocities)

    around = attributes.bracket(prim.GetAttribute(tokens.PACKED), code)
    cloud = decoded(around.lower)
    if not around.fraction or _shape(prim, around.lower) != _shape(prim, around.upper):
        return cloud
    return _mix(cloud, decoded(around.upper), around.fraction)


def fetch_arrays(prim: Usd.Prim, code: Usd.TimeCode, n: int) -> packing.PackedArrays | None:
    """Read a packed prim without decoding it; None between samples that are interpolated.

    Args:
        prim: Of the packed type.
        code: Result of `attributes.time_code`.
        n: Number of splats.

    Raises:
        StageError: If the layout is not one we know, or an array is missing or too short.
    """
    _check_layout(prim)
    around = attributes.bracket(prim.GetAttribute(tokens.PACKED), code)
    if around.fraction and _shape(prim, around.lower) == _shape(prim, around.upper):
        return None
    return _arrays(prim, around.lower, n)


def _check_layout(prim: Usd.Prim) -> None:
    token = prim.GetAttribute(tokens.PACKING).Get()
    if token != packing.TOKEN:
        raise _unfit(prim, tokens.PACKING, repr(token), repr(packing.TOKEN))


def _arrays(prim: Usd.Prim, sample: Usd.TimeCode, n: int) -> packing.PackedArrays:
    """Return the packed arrays of a sample, checked and truncated to `n` splats."""
    degree = attributes.degree(prim, sample)
    if not 0 <= degree <= MAX_DEGREE:
        raise _unfit(prim, tokens.SH_DEGREE, str(degree), f"0 to {MAX_DEGREE}")
    if not n:
        return packing.pack(_nothing(degree))
    return packing.PackedArrays(
        core=_rows(prim, tokens.PACKED, sample, n),
        color_range=_rows(prim, tokens.COLOR_RANGE, sample, 2),
        harmonics=_rows(prim, tokens.PACKED_HARMONICS, sample, n * packing.harmonics_width(degree)),
        harmonics_range=_rows(prim, tokens.HARMONICS_RANGE, sample, degree),
    )


def _rows(prim: Usd.Prim, name: str, sample: Usd.TimeCode, count: int) -> Any:
    """Return the first `count` rows of an array; raise an error if it is shorter."""
    found = attributes.array(prim, name, sample)
    if found is None:
        found = np.empty(_EMPTY[name], np.float32 if name in _FLOATS else np.int32)
    if len(found) < count:
        raise _unfit(prim, name, f"{len(found)} values", str(count))
    if name in _FLOATS and not np.isfinite(found).all():
        raise _unfit(prim, name, "a range that is not finite", "finite numbers")
    return found[:count]


def _mix(before: SplatCloud, after: SplatCloud, t: float) -> SplatCloud:
    """Interpolate decoded samples as USD interpolates stock ones; overwrites arrays of `after`."""
    for name in ("scales", "opacities", "sh"):
        start, end = getattr(before, name), getattr(after, name)
        end -= start
        end *= np.float32(t)
        end += start
    for first in range(0, len(after), _CHUNK):
        rows = slice(first, first + _CHUNK)
        turn = quaternion.slerp(before.rotations[rows], after.rotations[rows], t)
        after.rotations[rows] = turn
    return after


def _shape(prim: Usd.Prim, sample: Usd.TimeCode) -> tuple[int, int]:
    """Return the number of packed splats in a sample, and their degree."""
    return attributes.length(prim, tokens.PACKED, sample), attributes.degree(prim, sample)


def _nothing(degree: int) -> SplatCloud:
    """Return an empty cloud."""
    return SplatCloud(
        positions=np.empty((0, 3), np.float32),
        scales=np.empty((0, 3), np.float32),
        rotations=np.empty((0, 4), np.float32),
        opacities=np.empty(0, np.float32),
        sh=np.empty((0, coefficient_count(degree), 3), np.float32),
    )


def _unfit(prim: Usd.Prim, name: str, found: str, expected: str) -> StageError:
    return StageError(f"{prim.GetPath()}.{name}", found, expected)
