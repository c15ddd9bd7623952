"""Model of knobs for panels: kind of editor, limits, labels.

for editor in editors_of(settings):
    show(editor)                                  # a label, a slider, a list of choices, ...
settings = with_value(settings, "sh_degree", 2)   # raises UsageError if it is invalid
"""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import Knob, checked, knobs
from usdsplat.render.settings import FILE_KNOBS

T = TypeVar("T")
Kind = Literal["bool", "int", "float", "choice", "text", "vector", "color"]

AUTO = "auto"
"""Label of negative numbers that stand for an automatic choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Editor:
    """An editable value; all fields can be written as JSON."""

    name: str
    """Name for `with_value` or `set_parameter`."""
    label: str
    """Label, such as "SH degree"."""
    kind: Kind
    value: Any
    """bool, int, float, str, or a tuple of numbers; None has the meaning of `none_label`."""
    default: Any = None
    """Value if nothing is authored."""
    none_label: str = ""
    """Meaning of None, such as "unlimited"; "" for a value that is never None."""
    negative_label: str = ""
    """Meaning of all negative numbers, such as "auto"; "" where they are as good as others."""
    zero_label: str = ""
    """Meaning of 0, such as "all"; "" for a number like others."""
    minimum: float | None = None
    """Minimum, for each element of a vector; None for no limit."""
    maximum: float | None = None
    soft_range: tuple[float, float] = (0.0, 1.0)
    """Range of the slider, including the value; typed numbers may be any legal one."""
    step: float = 0.01
    """Step of the arrow keys."""
    is_whole: bool = False
    """Whether the elements of a vector are integers."""
    unit: str = ""
    choices: tuple[str, ...] = ()
    help: str = ""
    group: str = ""
    """Heading of its group."""
    is_animated: bool = False
    """Whether it has time samples; `value` is that of the requested time."""
    is_authored: bool = True
    """Whether the value is authored, rather than the default."""
    is_read_only: bool = False
    """Whether it cannot be edited."""
    is_main: bool = True
    """Whether it is of use to most people; panels show others on demand."""
    problem: str = ""
    """Why the authored value is not `value`, a sentence; "" without a problem."""


NOT_IN_VIEWPORTS = (*FILE_KNOBS, "node_wait")
"""Knobs of render settings that viewports do not offer: those of files, and `node_wait`, because a
viewport never waits and refines its picture at rest."""
_GROUPS: Mapping[str, tuple[str, ...]] = {
    "Splats": (
        "sorting",
        "rasterize_mode",
        "display_mode",
        "sh_degree",
        "splat_budget",
        "blend_space",
    ),
    "Light": (
        "lighting",
        "ambient",
        "self_shadows",
        "shadow_resolution",
        "light_samples",
        "dome_samples",
    ),
    "Levels of detail": ("lod_error", "lod_samples", "node_wait", "node_memory", "node_lifetime"),
    "Colour": (
        "color_mode",
        "working_space",
        "ocio_config",
        "ocio_display",
        "ocio_view",
        "ocio_look",
        "inverse_max",
    ),
    "Sampling": ("samples", "pixel_filter", "filter_width", "motion_blur", "depth_of_field"),
    "Surfaces": ("refinement",),
    "Files": FILE_KNOBS,
    "Display": ("exposure", "gamma", "channel", "background"),
    "Depth": ("depth_range", "colormap"),
    "Ids": ("id_colors",),
}
"""Heading -> knobs of settings below it."""
_OTHER = "Other"

_WORDS = {
    "aov": "AOV",
    "ccd": "CCD",
    "lod": "LOD",
    "ocio": "OCIO",
    "rd": "RD",
    "rgb": "RGB",
    "sh": "SH",
    "usd": "USD",
    "color": "colour",
    "colors": "colours",
    "colormap": "colour map",
    "neighbors": "neighbours",
    "rasterize": "rasterise",
    "k": "k",
    "h": "h",
    "u": "u",
    "v": "v",
}
"""Words of names -> spelling in labels."""

_WIDEST = {"deg": (-360.0, 360.0), "stop": (-8.0, 8.0)}
"""Widest range of a slider by unit, limited to legal values; values outside are typed."""
_SCALES = {"s": 2.0, "time code": 20.0, "unit/s^2": 2.0}
"""Typical value by unit, where the default gives no scale."""
_MANY = 100.0
"""Maximum range of a slider, in multiples of the typical value."""


def editors_of(instance: Any) -> tuple[Editor, ...]:
    """Return an editor for each knob of a dataclass instance, in order of declaration.

    Knobs without a simple editor, such as lists of vectors, are omitted.
    """
    headings = {name: heading for heading, names in _GROUPS.items() for name in names}
    return tuple(
        editor_of(item, getattr(instance, item.name), group=headings.get(item.name, _OTHER))
        for item in knobs(type(instance))
        if kind_of(item) is not None
    )


def with_value(instance: T, name: str, value: Any) -> T:
    """Return the settings with one value changed.

    Args:
        instance: Instance of a dataclass of knobs.
        name: Name of the editor.
        value: Value of the editor, or of the knob.

    Raises:
        UsageError: If the name is unknown, or the value is invalid.
    """
    known = {item.name: item for item in knobs(type(instance))}
    taken = typed(known[name], value) if name in known else value
    made = checked("settings", type(instance), {name: taken})
    return replace(typing.cast(Any, instance), **{name: getattr(made, name)})


def editor_of(item: Knob, value: Any, *, name: str | None = None, group: str = "") -> Editor:
    """Return the editor of a knob.

    Args:
        item: A knob with a kind, see `kind_of`.
        value: Current value.
        name: Name of the editor; None is the knob's own name.
        group: Heading of its group.
    """
    kind = kind_of(item)
    if kind is None:
        raise UsageError(item.name, "a list of vectors", "a value with a simple editor")
    low, high = item.range or (-math.inf, math.inf)
    parts = _numbers(value) or _numbers(item.default)
    is_whole = kind == "int" or int in typing.get_args(_plain(item.type))
    holds = str if kind == "choice" else shown
    span = (0.0, 1.0)
    if kind in ("int", "float", "vector"):
        span = soft_range(low, high, item.default, parts, unit=item.unit, is_whole=is_whole)
    return Editor(
        name=name or item.name,
        label=label(item.name),
        kind=kind,
        value=holds(value),
        default=holds(item.default),
        none_label=_none_label(item),
        negative_label=AUTO if item.default == -1 and low == -1 and kind != "choice" else "",
        minimum=low if math.isfinite(low) else None,
        maximum=high if math.isfinite(high) else None,
        soft_range=span,
        step=1.0 if is_whole else step(span),
        is_whole=is_whole,
        unit=item.unit,
        choices=tuple(map(str, item.choices or ())),
        help=item.text,
        group=group,
    )


def kind_of(item: Knob) -> Kind | None:
    """Return the kind of editor of a knob; None if there is none."""
    hint = _plain(item.type)
    if item.choices is not None:
        return "choice"
    if typing.get_origin(hint) is tuple:
        parts = typing.get_args(hint)
        if parts == (str, Ellipsis):
            return "text"
        if Ellipsis in parts or not set(parts) <= {int, float}:
            return None
        return "color" if (item.usd_type or "").startswith("color") else "vector"
    simple: dict[Any, Kind] = {bool: "bool", int: "int", float: "float", str: "text"}
    return simple.get(hint)


def typed(item: Knob, value: Any) -> Any:
    """Convert an editor's value to the knob's type, without a check of its range."""
    hint = _plain(item.type)
    if value is None and _is_infinite(item.default):
        return item.default
    if isinstance(value, str) and typing.get_origin(hint) is tuple:
        return tuple(part.strip() for part in value.split(",") if part.strip())
    if item.choices is not None:  # numeric choices are displayed as text
        return next((choice for choice in item.choices if str(choice) == str(value)), value)
    return value


def shown(value: Any) -> Any:
    """Convert a knob's value for an editor: infinity becomes None, names become one text."""
    if _is_infinite(value):
        return None
    if isinstance(value, (tuple, list)):
        if any(isinstance(part, str) for part in value) or not value:
            return ", ".join(value)
        return tuple(value)
    return value


def label(name: str) -> str:
    """Convert a name to a label: "sh_degree" becomes "SH degree"."""
    words = [_WORDS.get(word, word) for word in name.split("_")]
    first = words[0]
    words[0] = first if len(first) == 1 else first[0].upper() + first[1:]
    return " ".join(words)


def soft_range(
    low: float,
    high: float,
    default: Any,
    values: tuple[float, ...] = (),
    *,
    unit: str = "",
    is_whole: bool = False,
) -> tuple[float, float]:
    """Return the range of a slider: the legal range if it is practical, else the usual one.

    Args:
        low, high: Legal range; infinite for no limit.
        default: A number or a tuple of numbers, which gives the scale.
        values: Current values, which are always in the range.
        unit: Unit, which may have a practical limit.
        is_whole: Whether values are integers.
    """
    finite = [abs(part) for part in _numbers(default) if math.isfinite(part)]
    usual = 8.0 if is_whole else _SCALES.get(unit, 1.0)
    scale = max(finite, default=0.0) or usual
    if is_whole:
        scale = max(scale, usual)
    least, most = -_nice(4 * scale), _nice(4 * scale)
    if unit in _WIDEST:
        least, most = _WIDEST[unit]
    elif high - low <= _MANY * scale:
        least, most = low, high
    least, most = max(low, least), min(high, most)
    legal = [part for part in values if math.isfinite(part)]
    return float(min([least, *legal])), float(max([most, *legal]))


def step(span: tuple[float, float]) -> float:
    """Return the step of the arrow keys: a round number of about a hundredth of the range."""
    return _nice((span[1] - span[0]) / 200) or 0.01


def _nice(number: float) -> float:
    """Return the smallest of 1, 2, 5, 10, ... times a power of ten that is not less."""
    if not 0 < number < math.inf:
        return 0.0
    power = 10.0 ** math.floor(math.log10(number))
    return next(
        (round(lead * power, 12) or lead * power for lead in (1, 2, 5) if lead * power >= number),
        10 * power,
    )


def _none_label(item: Knob) -> str:
    """Return the meaning of None for a knob."""
    if _is_infinite(item.default):
        return "first" if item.default < 0 else "unlimited"
    return "automatic" if type(None) in _options(item.type) else ""


def _is_infinite(value: Any) -> bool:
    return isinstance(value, float) and math.isinf(value)


def _numbers(value: Any) -> tuple[float, ...]:
    """Return the numbers of a value."""
    parts = value if isinstance(value, (tuple, list)) else (value,)
    return tuple(part for part in parts if isinstance(part, (int, float)))


def _plain(hint: Any) -> Any:
    """Return an annotation without None."""
    return next(option for option in _options(hint) if option is not type(None))


def _options(hint: Any) -> tuple[Any, ...]:
    is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if is_union else (hint,)
