"""Fit the table with which one splat becomes n, and print how well the children stand for it.

    python -m benchmarks.split_table

A splat of opacity A is in its own standard deviations A exp(-(x^2 + y^2) / 2). Its n children along
x, each with offset m, size s along and t across, and opacity a, are composited:

    1 - prod(1 - a exp(-((x - m) / s)^2 / 2 - (y / t)^2 / 2))

s is the least and the largest for each n; the rest is fitted by Levenberg-Marquardt over the
ellipse in which the splat is drawn, so that the profile holds at every y, where the splat is
fainter. Children that overlap lose more where they are opaque, which sizes t other than 1 make up
for. Mass and second moments of the composite are held to those of the splat. Solutions are followed
from faint splats to opaque ones, so that the table can be interpolated.

The first output is the table of `usdsplat/sim/split_table.py`. The second is the noise of the
composite over the ellipse [dB], for a peak of 1, of the least s, the largest, and one between; its
last rows are children that are split again along the same axis and along the other one, children
without t, and halves of halves.
"""

from __future__ import annotations

import math
import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from usdsplat.core.cloud import F64
from usdsplat.sim.split_table import OPACITIES, SIGMAS

SHOWN = (0.1, 0.25, 0.5, 0.7, 0.85, 0.95, 0.98)
"""Opacities at which noise is shown."""
STEP = 0.02
"""Largest step of opacity in which solutions are followed."""
REACH, FAR = 3.4, 5.5
"""Radius of the ellipse in which a splat is drawn, and of that of its moments."""
ACROSS = (0.8, 1.1)
"""Limits of t."""
MOMENTS = 0.15
"""Weight of the moments in the sum of squares."""
SMALL = 0.375
"""Size of halves of halves."""
ITERATIONS, ENOUGH = 300, 1e-7
"""Largest number of iterations, and relative gain at which they end."""


@dataclass(frozen=True, slots=True, eq=False)
class Disc:
    """Points of the upper half of a disc, and their share of its area."""

    x: F64
    y: F64
    share: F64

    @classmethod
    def of(cls, radius: float, columns: int, rows: int) -> Disc:
        """Return the points of a grid that are in the disc."""
        along, across = np.linspace(-radius, radius, columns), np.linspace(0, radius, rows)
        x, y = np.meshgrid(along, across, indexing="ij")
        share = np.where(y > 0, 1.0, 0.5)
        inside = x**2 + y**2 <= radius**2
        return cls(x[inside], y[inside], share[inside] / share[inside].sum())


DRAWN, WIDE = Disc.of(REACH, 61, 25), Disc.of(FAR, 67, 34)


@dataclass(frozen=True, slots=True, eq=False)
class Children:
    """n children of one splat, in its standard deviations."""

    offset: F64
    """Shape (n, 2)."""
    size: F64
    """Shape (n, 2)."""
    opacity: F64
    """Shape (n,)."""

    def composite(self, where: Disc) -> F64:
        """Return the opacity of all children together."""
        clear = np.ones_like(where.x)
        for (m, o), (s, t), a in zip(self.offset, self.size, self.opacity, strict=True):
            clear *= 1 - a * np.exp(-0.5 * (((where.x - m) / s) ** 2 + ((where.y - o) / t) ** 2))
        return 1 - clear

    def moments(self, opacity: float) -> F64:
        """Return the relative errors of mass, and of the second moments along and across."""
        weights = np.stack([np.ones_like(WIDE.x), WIDE.x**2, WIDE.y**2]) * WIDE.share
        return np.asarray(weights @ self.composite(WIDE) / (weights @ splat(opacity, WIDE)) - 1)

    def noise(self, opacity: float) -> float:
        """Return the noise against a splat [dB]."""
        error = self.composite(DRAWN) - splat(opacity, DRAWN)
        return float(-10 * math.log10(DRAWN.share @ error**2))


def splat(opacity: float, where: Disc) -> F64:
    """Return the opacity of one splat."""
    return np.asarray(opacity * np.exp(-0.5 * (where.x**2 + where.y**2)))


# --- the fit ---------------------------------------------------------------------------


def children_of(values: F64, n: int, sigma: float, *, is_plain: bool = False) -> Children:
    """Return the children of fitted numbers.

    Args:
        values: Offset, opacity and size across of the right half, from the middle out; the latter
            two are any number.
        n: Number of children.
        sigma: Size along the axis.
        is_plain: Whether sizes across are 1.
    """
    offset, opacity, across = values.reshape(3, -1)
    low, high = (1.0, 1.0) if is_plain else ACROSS
    right = np.stack([np.abs(offset), _squeezed(opacity), low + (high - low) * _squeezed(across)])
    right = right[:, np.argsort(right[0], kind="stable")]
    if n % 2:
        right[0, 0] = 0
    left = right[:, n % 2 :][:, ::-1] * [[-1], [1], [1]]
    m, a, t = np.concatenate([left, right], axis=1)
    zero, size = np.zeros_like(m), np.full_like(m, sigma)
    return Children(np.stack([m, zero], axis=1), np.stack([size, t], axis=1), a)


def _squeezed(value: F64) -> F64:
    return np.asarray(1 / (1 + np.exp(-value)))


def start(n: int, sigma: float, opacity: float) -> F64:
    """Return numbers to start from: even offsets with the splat's second moment."""
    apart = math.sqrt((1 - sigma**2) * 12 / (n * n - 1))
    offset = (apart * (np.arange(n) - (n - 1) / 2))[n // 2 :]
    share = 0.7 * opacity * np.exp(-0.5 * offset**2)
    low, high = ACROSS
    across = (0.99 - low) / (high - low)
    return np.concatenate(
        [offset, np.log(share / (1 - share)), np.full_like(offset, math.log(across / (1 - across)))]
    )


def fitted(values: F64, n: int, sigma: float, opacity: float, *, is_plain: bool = False) -> F64:
    """Improve numbers by Levenberg-Marquardt.

    Source: Marquardt 1963, "An algorithm for least-squares estimation of nonlinear parameters".
    """
    weight, goal = np.sqrt(DRAWN.share), splat(opacity, DRAWN)

    def residual(now: F64) -> F64:
        children = children_of(now, n, sigma, is_plain=is_plain)
        error = weight * (children.composite(DRAWN) - goal)
        return np.concatenate([error, MOMENTS * opacity * children.moments(opacity)])

    here, damping = residual(values), 1e-3
    for _ in range(ITERATIONS):
        slopes = np.stack(
            [(residual(values + step) - here) / 1e-6 for step in 1e-6 * np.eye(len(values))], axis=1
        )
        square, slope = slopes.T @ slopes, slopes.T @ here
        for _ in range(12):
            damped = square + damping * np.diag(np.diag(square) + 1e-10)
            near = values + np.clip(np.linalg.solve(damped, -slope), -0.4, 0.4)
            there = residual(near)
            if there @ there < here @ here:
                break
            damping *= 4
        else:
            return values
        gain = 1 - there @ there / (here @ here)
        values, here, damping = near, there, max(damping / 5, 1e-12)
        if gain < ENOUGH:
            break
    return values


def followed(n: int, sigma: float, *, is_plain: bool = False) -> list[Children]:
    """Return the children at each of OPACITIES."""
    now = OPACITIES[0]
    values, found = start(n, sigma, now), []
    for goal in OPACITIES:
        for opacity in np.linspace(now, goal, max(1, math.ceil((goal - now) / STEP)) + 1)[1:]:
            values = fitted(values, n, sigma, float(opacity), is_plain=is_plain)
        found.append(children_of(values, n, sigma, is_plain=is_plain))
        now = goal
    return found


# --- what becomes of it ------------------------------------------------------------------


def interpolated(rows: Sequence[Children], opacity: float) -> Children:
    """Return the children of a splat from those at each of OPACITIES."""
    nodes = np.array(OPACITIES)
    at = min(max(opacity, nodes[0]), nodes[-1])
    i = min(int(np.searchsorted(nodes, at, "right")) - 1, len(nodes) - 2)
    low, high = (replace(each, opacity=each.opacity / nodes[j]) for j, each in _two(rows, i))
    mixed = between(low, high, float((at - nodes[i]) / (nodes[i + 1] - nodes[i])))
    return replace(mixed, opacity=np.minimum(opacity * mixed.opacity, 1))


def _two(rows: Sequence[Children], i: int) -> Iterator[tuple[int, Children]]:
    yield from ((i, rows[i]), (i + 1, rows[i + 1]))


def between(low: Children, high: Children, part: float) -> Children:
    """Interpolate."""
    return Children(
        *(
            (1 - part) * getattr(low, name) + part * getattr(high, name)
            for name in ("offset", "size", "opacity")
        )
    )


def again(rows: Sequence[Children], whole: Children, axis: int) -> Children:
    """Return the children of children, along the same axis, 0, or along the other one, 1."""
    order = (axis, 1 - axis)
    parts = [interpolated(rows, opacity) for opacity in whole.opacity]
    offsets, sizes = zip(*((p.offset[:, order], p.size[:, order]) for p in parts), strict=True)
    return Children(
        np.concatenate(
            [m + s * o for m, s, o in zip(whole.offset, whole.size, offsets, strict=True)]
        ),
        np.concatenate([s * t for s, t in zip(whole.size, sizes, strict=True)]),
        np.concatenate([p.opacity for p in parts]),
    )


def source(ends: Sequence[Sequence[Children]], n: int) -> Iterator[str]:
    """Yield the lines of the table for one n: offset, size across and opacity of the right half,
    the latter as a fraction of the splat's; with the least s, then with the largest."""
    yield f"    {n}: ("
    for rows in ends:
        yield "        ("
        for opacity, children in zip(OPACITIES, rows, strict=True):
            right = slice(n // 2, None)
            share = children.opacity[right] / opacity
            columns = (children.offset[right, 0], children.size[right, 1], share)
            line = f"({', '.join(_numbers(column) for column in columns)}),"
            yield textwrap.indent(textwrap.fill(line, 88, subsequent_indent=" "), " " * 12)
        yield "        ),"
    yield "    ),"


def _numbers(values: F64) -> str:
    text = ", ".join(f"{value:.3f}" for value in np.abs(values))
    return f"({text})" if len(values) > 1 else f"({text},)"


def halved(size: float, *, is_plain: bool) -> tuple[float, int, dict[float, Children]]:
    """Return halves of halves that are as small as a third, and the number of times."""
    pair = followed(2, size, is_plain=is_plain)
    ways = {opacity: interpolated(pair, opacity) for opacity in SHOWN}
    times = 1
    while size**times > SMALL:
        ways = {opacity: again(pair, each, 0) for opacity, each in ways.items()}
        times += 1
    return size**times, times, ways


def main(report: Report) -> None:
    """Fit, and print both tables."""
    fits = {n: tuple(followed(n, sigma) for sigma in ends) for n, ends in SIGMAS.items()}
    print("CHILDREN = {")
    for n in SIGMAS:
        print("\n".join(source(fits[n], n)))
    print("}")
    table = Table(
        title=r"noise of n children against their splat \[dB], by its opacity",
        caption="moments: largest relative error of mass and second moments at opacity 0.95",
    )
    for column in ("children", "size", *map(str, SHOWN), "moments"):
        table.add_column(column, justify="left" if column == "children" else "right")

    def show(label: str, size: float, ways: dict[float, Children]) -> None:
        cells = {opacity: children.noise(opacity) for opacity, children in ways.items()}
        off = np.abs(ways[0.95].moments(0.95)).max()
        table.add_row(label, f"{size:.3f}", *(f"{c:.1f}" for c in cells.values()), f"{off:.1%}")
        report.add(scene=label, size=size, db=cells, moments=off)

    for n, (least, most) in SIGMAS.items():
        for part in (0.0, 0.5, 1.0):
            ways = {
                opacity: between(*(interpolated(rows, opacity) for rows in fits[n]), part)
                for opacity in SHOWN
            }
            show(str(n), least + part * (most - least), ways)
    for label, n, axis, size in (
        ("5, each 5 along the same axis", 5, 0, SIGMAS[5][0] ** 2),
        ("5, each 5 along the other axis", 5, 1, SIGMAS[5][0]),
        ("12, each 12 along the same axis", 12, 0, SIGMAS[12][0] ** 2),
    ):
        wholes = {opacity: interpolated(fits[n][0], opacity) for opacity in SHOWN}
        show(label, size, {each: again(fits[n][0], wholes[each], axis) for each in SHOWN})
    for n in (5, 8):
        plain = followed(n, SIGMAS[n][0], is_plain=True)
        ways = {opacity: interpolated(plain, opacity) for opacity in SHOWN}
        show(f"{n}, all as wide as the splat", SIGMAS[n][0], ways)
    for half, is_plain in ((SIGMAS[2][0], False), (0.71, True)):
        size, times, ways = halved(half, is_plain=is_plain)
        show(f"2, {times} times{', all as wide as the splat' if is_plain else ''}", size, ways)
    report.show(table)


if __name__ == "__main__":
    with Report("split_table", sys.argv[1:]) as report:
        main(report)
