"""Apply edits during conversions, and track their effect on error bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import numpy.typing as npt

from usdsplat.core import edit, morton
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.edits import Edit, Numbers
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.core.wording import counted

Rows = npt.NDArray[np.bool_]
Work = Callable[[SplatCloud, Numbers, "_Circumstances"], SplatCloud]

_FIELDS = ("positions", "scales", "rotations", "opacities", "sh")
_CHANGED = {
    "rotate": ("positions", "sh"),
    "scale": ("positions", "scales"),
    "decimate": _FIELDS,
}
"""Edit -> fields whose values, and therefore errors, it mixes or scales."""
UNBOUNDED = "unbounded"
"""Prefix of a bound that is unlimited."""
_MERGED = f"{UNBOUNDED}: splats were merged by "
"""Prefix of the bound of fields that were exact before a decimation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Circumstances:
    """What edits may need to know besides their values."""

    antialiased: bool
    progress: Progress


def edited(
    cloud: SplatCloud,
    edits: Sequence[Edit],
    *,
    may_empty: bool = False,
    antialiased: bool = False,
    progress: Progress = silent,
) -> tuple[SplatCloud, tuple[str, ...]]:
    """Apply edits in order.

    Consecutive affine maps are combined, so that harmonics are rotated once.

    Args:
        may_empty: Whether the result may be empty.
        antialiased: Whether the splats are drawn antialiased, not with the low-pass of classic
            mode, which decimation takes into account.
        progress: Receives the progress of the steps.

    Returns:
        The cloud, and a note for each edit that dropped splats.

    Raises:
        UsageError: If no splat is left, or values exceed float32, naming the edit.
    """
    steps = [list(group) for _, group in groupby(enumerate(edits), key=_step)]
    notes, around = [], _Circumstances(antialiased=antialiased, progress=progress)
    for done, step in enumerate(steps):
        progress.step("editing", done, len(steps))
        group, before = [item for _, item in step], len(cloud)
        if group[0].kind.moves:
            cloud = _moved(cloud, group)
        else:
            cloud = _WORK[group[0].name](cloud, group[0].values, around)
        if before and not len(cloud) and not may_empty:
            expected = f"some of the {counted(before, 'splat')} before it"
            raise UsageError(f"edit {group[0].name}", "no splat left", expected)
        if len(cloud) != before:
            notes.append(f"{group[0]}: {counted(len(cloud), 'splat')} of {before} left")
    progress.step("editing", len(steps), len(steps))
    return cloud, tuple(notes)


def bounds_after(bounds: Mapping[str, str], edits: Sequence[Edit]) -> dict[str, str]:
    """Return the error bounds of a source, worded to hold after the edits."""
    after = dict(bounds)
    for name in bounds:
        said = [str(item) for item in edits if name in _CHANGED.get(item.name, ())]
        if said:
            after[name] += f", before {' and '.join(said)}"
    merges = [str(item) for item in edits if item.name == "decimate"]
    exact = [name for name in _FIELDS if merges and name not in bounds]
    return after | dict.fromkeys(exact, f"{_MERGED}{' and '.join(merges)}")


def map_of(edits: Sequence[Edit]) -> F64:
    """Return the product of all affine maps among edits, column vectors, shape (4, 4)."""
    matrix = np.eye(4)
    for item in edits:
        if item.kind.moves:
            matrix = matrix_of(item) @ matrix
    return matrix


def matrix_of(item: Edit) -> F64:
    """Return the matrix of an affine edit, column vectors, shape (4, 4)."""
    matrix = np.eye(4)
    if item.name == "translate":
        matrix[:3, 3] = item.values
    elif item.name == "scale":
        matrix[:3, :3] *= item.values[0]
    else:
        matrix[:3, :3] = _rotation(item.values)
    return matrix


def _step(numbered: tuple[int, Edit]) -> int:
    """Return a group key: equal for consecutive affine maps, unique for other edits."""
    place, item = numbered
    return -1 if item.kind.moves else place


def _moved(cloud: SplatCloud, moves: Sequence[Edit]) -> SplatCloud:
    """Return the cloud after all these maps, in order."""
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = map_of(moves)
    moved = edit.transform(cloud, matrix) if np.isfinite(matrix).all() else None
    if moved is None or edit.overflows(cloud, moved):
        names = " and ".join(dict.fromkeys(item.name for item in moves))
        raise UsageError(f"edit {names}", "splats beyond the float32 range", "smaller numbers")
    return moved


def _rotation(degrees: Numbers) -> F64:
    """Return the rotation about x, then y, then z; exact for right angles."""
    matrix = np.eye(3)
    for axis, angle in enumerate(degrees):
        cosine, sine = _on_circle(angle)
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = cosine, -sine, sine, cosine
        matrix = turn @ matrix
    return matrix


def _on_circle(degrees: float) -> tuple[float, float]:
    """Return cosine and sine, exact at right angles."""
    quarters = degrees / 90
    if quarters == int(quarters):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
    return float(np.cos(np.radians(degrees))), float(np.sin(np.radians(degrees)))


def _crop_box(cloud: SplatCloud, values: Numbers, _: _Circumstances) -> SplatCloud:
    return edit.crop_box(cloud, values[:3], values[3:])


def _crop_sphere(cloud: SplatCloud, values: Numbers, _: _Circumstances) -> SplatCloud:
    return edit.crop_sphere(cloud, values[:3], values[3])


def _keeping(rows: Callable[[SplatCloud, float], Rows]) -> Work:
    """Return an edit that keeps the rows allowed by a limit."""

    def work(cloud: SplatCloud, values: Numbers, _: _Circumstances) -> SplatCloud:
        kept = rows(cloud, values[0])
        return cloud if kept.all() else edit.take(cloud, kept)

    return work


def _sizes(cloud: SplatCloud) -> F32:
    """Return the largest standard deviations, shape (n,)."""
    return np.asarray(cloud.scales.max(axis=1, initial=0))


def _drop_nan(cloud: SplatCloud, _: Numbers, _around: _Circumstances) -> SplatCloud:
    return edit.prune(cloud)


def _drop_outliers(cloud: SplatCloud, values: Numbers, _: _Circumstances) -> SplatCloud:
    # Imported here because it loads Numba, which most edits do not need.
    from usdsplat.interchange.outliers import drop_outliers

    return drop_outliers(cloud, neighbors=int(values[0]), deviations=values[1])


def _cut_harmonics(cloud: SplatCloud, values: Numbers, _: _Circumstances) -> SplatCloud:
    return edit.with_sh_degree(cloud, min(int(values[0]), cloud.sh_degree))


def _decimate(cloud: SplatCloud, values: Numbers, around: _Circumstances) -> SplatCloud:
    # Imported here because it loads Numba.
    from usdsplat.interchange.decimating import decimate, framing_pixel

    wanted = values[0] if values[0] >= 1 else max(round(values[0] * len(cloud)), 1)
    pixel = 0.0 if around.antialiased else framing_pixel(cloud)
    return decimate(cloud, int(wanted), pixel=pixel, progress=around.progress)


def _in_z_order(cloud: SplatCloud, _: Numbers, _around: _Circumstances) -> SplatCloud:
    return edit.take(cloud, morton.order(cloud.positions))


_WORK: Mapping[str, Work] = {
    "crop-box": _crop_box,
    "crop-sphere": _crop_sphere,
    "min-opacity": _keeping(lambda cloud, limit: cloud.opacities >= np.float32(limit)),
    "max-opacity": _keeping(lambda cloud, limit: cloud.opacities <= np.float32(limit)),
    "min-size": _keeping(lambda cloud, limit: _sizes(cloud) >= np.float32(limit)),
    "max-size": _keeping(lambda cloud, limit: _sizes(cloud) <= np.float32(limit)),
    "drop-nan": _drop_nan,
    "drop-outliers": _drop_outliers,
    "sh-degree": _cut_harmonics,
    "decimate": _decimate,
    "morton": _in_z_order,
}
"""Edit -> function, for edits that are not affine maps."""
