"""Prims as a tree shows them: one row each, the children when somebody opens their parent."""

from __future__ import annotations

from dataclasses import dataclass

from pxr import Usd


@dataclass(frozen=True, slots=True, kw_only=True)
class PrimRow:
    """One prim in the tree."""

    path: str
    name: str
    type_name: str
    """Such as "Mesh"; "" for a prim without one."""
    purpose: str
    """As it is in effect, inherited or not: default, render, proxy or guide; "" without any."""
    is_visible: bool
    """Whether it can be seen at the time: neither itself nor an ancestor is invisible."""
    is_hidden_itself: bool
    """Whether it is invisible by its own word, not an ancestor's."""
    is_imageable: bool
    """Whether it has a visibility at all."""
    is_active: bool
    is_loaded: bool
    is_instance: bool
    is_in_instance: bool
    """Whether it is part of an instance, and so cannot be edited."""
    is_abstract: bool
    """Whether it is a class."""
    is_defined: bool
    """Whether it is more than opinions over nothing."""
    kind: str
    """Such as "component"; "" for none."""
    variants: tuple[tuple[str, str, tuple[str, ...]], ...]
    """Set, selection, and what it can be."""
    has_children: bool
    is_splats: bool
    is_camera: bool
    is_affector: bool
    is_simulation: bool


def children(
    stage: Usd.Stage,
    path: str = "/",
    *,
    time: float | None = None,
    undefined: bool = False,
    abstract: bool = False,
) -> tuple[PrimRow, ...]:
    """The children of a prim, in their order.

    Args:
        stage: Whose.
        path: Of the prim; "/" for the roots.
        time: Time code; None is USD's default time.
        undefined: Whether prims that are only opinions over nothing are shown.
        abstract: Whether classes are shown.

    Raises:
        StageError: If there is no such prim.
    """
    raise NotImplementedError


def row(stage: Usd.Stage, path: str, *, time: float | None = None) -> PrimRow:
    """One prim.

    Raises:
        StageError: If there is no such prim.
    """
    raise NotImplementedError


def search(stage: Usd.Stage, text: str, *, most: int = 1000) -> tuple[str, ...]:
    """Paths of the prims whose name, path or type has a text in it, in the order of the stage.

    Args:
        stage: Where to look.
        text: In upper or lower case; "*" stands for anything, and then the whole name, path or
            type must match. A text with "/" in it is looked for in paths alone.
        most: How many are found at most.
    """
    raise NotImplementedError
