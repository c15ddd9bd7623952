"""Bake a simulation once for each combination of some parameters' values, and compare the bakes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_origin

from pxr import Usd

from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.findings import Findings
from usdsplat.core.progress import Progress, silent
from usdsplat.products.contact_sheet import Sheet, draw_sheet
from usdsplat.sim.stage.authoring import find
from usdsplat.sim.stage.overrides import override
from usdsplat.sim.stage.report import Report
from usdsplat.sim.stage.simulating import SIMULATE, SimulateOptions, simulate
from usdsplat.sim.stage.twins import twin

MOST = 100
"""Largest number of combinations; more are typing errors."""
LONGEST = 200
"""Largest length of a file's name [byte]; systems allow 255, and folders beside it are longer."""
_AXIS = re.compile(r"((?:/[^.=]+\.)?[A-Za-z]\w*(?::\w+)+)=(.*)")
_UNSAFE = re.compile(r"[^\w.+-]+")


@dataclass(frozen=True, slots=True)
class Axis:
    """A parameter and the values that it takes."""

    name: str
    """`[/PRIM.]group:name`, as for `override`."""
    values: tuple[str, ...]

    @property
    def settings(self) -> tuple[str, ...]:
        """The assignments, such as "rd:feed=0.03"."""
        return tuple(f"{self.name}={value}" for value in self.values)


@dataclass(frozen=True, slots=True)
class Combination:
    """One bake of a wedge."""

    settings: tuple[str, ...]
    """An assignment for each axis."""
    target: Path
    """Layer of results."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WedgeOptions:
    """Options of a wedge."""

    simulate: SimulateOptions = SIMULATE
    """Options of each bake; they apply to the contact sheet too."""
    frame: float | None = None
    """Frame of the contact sheet [time code]; None is the last one."""
    baked: Callable[[int, int], None] = lambda done, total: None
    """Called with the number of finished bakes and of all, before each bake. An exception that it
    raises ends the wedge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WedgeReport:
    """The files of a wedge."""

    sheet: str
    """The contact sheet."""
    bakes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Path of each bake -> its settings, such as "rd:feed=0.03"."""
    reports: tuple[Report, ...] = ()
    """Statistics of each bake."""


def parse_axes(texts: Sequence[str]) -> tuple[Axis, ...]:
    """Parse parameters and their values, such as "rd:feed=0.03,0.05".

    Raises:
        UsageError: If one cannot be parsed, names a parameter twice or without values, repeats a
            value, or a parameter does not exist or has several values at once.
    """
    axes: list[Axis] = []
    for text in texts:
        match = _AXIS.fullmatch(text.strip())
        if not match:
            expected = "[/PRIM.]group:name=value,value, such as rd:feed=0.03,0.05"
            raise UsageError("--wedge", repr(text), expected)
        name, typed = match.groups()
        values = tuple(part.strip() for part in typed.split(","))
        if not all(values):
            raise UsageError(f"--wedge {name}", repr(typed), "values separated by commas")
        if len(set(values)) < len(values):
            raise UsageError(f"--wedge {name}", f"{typed!r}, a value twice", "each value once")
        if name in [axis.name for axis in axes]:
            raise UsageError("--wedge", f"{name} twice", "each parameter once")
        _, _, knob = find(name.rpartition(".")[2])
        if get_origin(knob.type) is tuple:
            found = f"{name}, which is a list"
            raise UsageError("--wedge", found, "a parameter of one number or word")
        axes.append(Axis(name, values))
    return tuple(axes)


def combinations(axes: Sequence[Axis], target: Path) -> tuple[Combination, ...]:
    """Return all combinations of the values; those of the last axis change first.

    Args:
        axes: At least one.
        target: A name beside which the bakes are written, which name their values:
            bake.usda leads to bake_rd-feed=0.03_settle-omega=4.usda.

    Raises:
        UsageError: If there are too many, or two have the same name.
    """
    found = []
    for settings in itertools.product(*(axis.settings for axis in axes)):
        name = "_".join((target.stem, *map(_in_names, settings))) + target.suffix
        found.append(Combination(settings, target.with_name(name)))
        if len(found) > MOST:
            raise UsageError("--wedge", f"more than {MOST} combinations", "fewer values")
        if len(name.encode()) > LONGEST:
            raise UsageError("--wedge", f"the file {name[:40]}...", f"a name of {LONGEST} bytes")
    targets = [each.target for each in found]
    for each in targets:
        if targets.count(each) > 1:
            raise UsageError("--wedge", f"two bakes named {each.name}", "values with other names")
    return tuple(found)


def planned(
    stage: Usd.Stage,
    target: Path,
    frames: Sequence[float],
    axes: Sequence[Axis],
    options: WedgeOptions,
) -> tuple[Combination, ...]:
    """Check a wedge, and return its combinations. Arguments and errors are those of `wedge`."""
    shown = frames[-1] if options.frame is None else options.frame
    if shown not in frames:
        expected = f"one of {frames[0]:g} to {frames[-1]:g}"
        raise UsageError("--sheet-frame", f"{shown:g}", expected)
    made = combinations(axes, target)
    tried = twin(stage)
    for setting in (each for axis in axes for each in axis.settings):
        override(tried, setting, where="--wedge")
    if options.simulate.existing == "error":
        for path in (*(each.target for each in made), target.with_suffix(".png")):
            if path.exists():
                raise OutputError(str(path), "a file", "a new name, or --resume or --force")
    return made


def wedge(
    stage: Usd.Stage,
    target: Path,
    frames: Sequence[float],
    axes: Sequence[Axis],
    options: WedgeOptions,
    *,
    progress: Progress = silent,
    findings: Findings | None = None,
    rates: Path | None = None,
) -> WedgeReport:
    """Bake every combination of some parameters' values, and draw a contact sheet.

    A bake has the bytes of one with these values on the command line.

    Args:
        stage: As for `simulate`; it is not changed.
        target: The bakes are written beside it, see `combinations`, and the contact sheet to the
            same name with the suffix .png.
        frames: As for `simulate`.
        axes: Parameters with their values.
        options: How existing bakes are treated, and the frame of the contact sheet.
        progress, findings, rates: As for `simulate`.

    Raises:
        UsageError: If the axes or the frame of the contact sheet cannot be used.
        UsdSplatError: As for `simulate`. Finished bakes are kept.
    """
    findings = Findings() if findings is None else findings
    made = planned(stage, target, frames, axes, options)
    sheet = target.with_suffix(".png")
    shown = frames[-1] if options.frame is None else options.frame
    reports = []
    for number, each in enumerate(made, 1):
        options.baked(number - 1, len(made))
        findings.say(f"{number} of {len(made)}: {each.target.name}")
        changed = twin(stage)
        for setting in each.settings:
            override(changed, setting, where="--wedge")
        reports.append(
            simulate(
                changed, each.target, frames, options.simulate, progress=progress,
                findings=findings, rates=rates,
            )
        )  # fmt: skip
    columns, device = axes[-1].settings, options.simulate.device
    cells = [each.target for each in made]
    rows = ["\n".join(each.settings[:-1]) for each in made[:: len(columns)]]
    draw_sheet(
        Sheet(cells=cells, rows=rows, columns=columns), sheet, frame=shown, progress=progress,
        device=device if isinstance(device, str) else "auto", threads=options.simulate.threads,
    )  # fmt: skip
    settings = {str(each.target): each.settings for each in made}
    return WedgeReport(sheet=str(sheet), bakes=settings, reports=tuple(reports))


def _in_names(setting: str) -> str:
    """Return an assignment as a part of a file's name."""
    name, _, value = setting.partition("=")
    where, _, knob = name.rpartition(".")
    known = f"{where.strip('/').replace('/', '-')}." if where else ""
    parts = known + knob.replace(":", "-"), value
    return "=".join(_UNSAFE.sub("_", part) for part in parts)
