"""What a user does to a stage: opinions on its session layer, each step with a way back.

    edits = Edits(stage)
    edits.set_value("/World/Ball.radius", 2.0)
    edits.undo()                                     # "Set radius"

No file is touched. A step that fails leaves nothing behind. Steps in a row with the same `merge`
key become one, so that a drag is undone at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pxr import Usd

from usdsplat.delegate.specs import Matrix


class Edits:
    """The edits of one stage, and how to take them back."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.stage = stage

    @property
    def undoable(self) -> str | None:
        """What `undo` would take back; None for nothing."""
        raise NotImplementedError

    @property
    def redoable(self) -> str | None:
        """What `redo` would do again; None for nothing."""
        raise NotImplementedError

    def undo(self) -> str | None:
        """Take the last step back; returns its name, None if there is none."""
        raise NotImplementedError

    def redo(self) -> str | None:
        """Do what was taken back last again; returns its name, None if there is none."""
        raise NotImplementedError

    @contextmanager
    def step(self, name: str, *paths: str, merge: str | None = None) -> Iterator[None]:
        """Whatever is authored inside, on the session layer, becomes one step.

        Args:
            name: What it is, such as "Set radius".
            paths: Of all prims and properties that may be authored, those to be made among them.
            merge: Steps in a row with the same one are one.

        Raises:
            StageError: If one of them cannot be edited: it is in an instance, or no path.
        """
        raise NotImplementedError

    def set_value(
        self, path: str, value: Any, *, time: float | None = None, merge: str | None = None
    ) -> None:
        """Give an attribute a value.

        Args:
            path: Of the attribute, such as "/World/Ball.radius".
            value: As the attribute's editor has it: bool, number, str, or a sequence of numbers.
            time: Time code of a sample; None is the value where there are no samples.
            merge: As for `step`.

        Raises:
            StageError: If there is no such attribute, or it cannot be edited.
            UsageError: If it cannot have that value.
        """
        raise NotImplementedError

    def clear(self, path: str) -> None:
        """Take back whatever the session layer says of a property; other layers stay.

        Raises:
            StageError: If it says nothing of it.
        """
        raise NotImplementedError

    def set_visible(self, path: str, is_visible: bool) -> None:
        """Show or hide a prim at all times; what is shown is shown whatever hid it above.

        Raises:
            StageError: If there is no such prim, or it cannot be hidden.
        """
        raise NotImplementedError

    def set_active(self, path: str, is_active: bool) -> None:
        """Take a prim, and all below it, off the stage, or bring it back.

        Raises:
            StageError: If there is no such prim.
        """
        raise NotImplementedError

    def set_purpose(self, path: str, purpose: str) -> None:
        """Give a prim a purpose: default, render, proxy or guide.

        Raises:
            StageError: If there is no such prim, or it cannot have one.
            UsageError: If it is no purpose.
        """
        raise NotImplementedError

    def set_variant(self, path: str, variant_set: str, variant: str) -> None:
        """Select a variant; "" takes a selection of the session layer back.

        Raises:
            StageError: If there is no such prim or set.
            UsageError: If the set has no such variant.
        """
        raise NotImplementedError

    def set_transform(
        self,
        path: str,
        matrix: Matrix,
        *,
        time: float | None = None,
        is_keyed: bool = False,
        merge: str | None = None,
    ) -> None:
        """Put a prim somewhere.

        Args:
            path: Of the prim.
            matrix: Local to world, 16 numbers, row-major, for column vectors: `transform` and a
                drag on top.
            time: When the prim is to be there; what is animated goes on moving, from there.
            is_keyed: Whether that holds at this time alone, as a time sample, rather than always.
            merge: As for `step`.

        Raises:
            StageError: If there is no such prim, or it cannot be moved.
            UsageError: If the matrix is none that can be undone.
        """
        raise NotImplementedError


def transform(stage: Usd.Stage, path: str, *, time: float | None = None) -> Matrix:
    """Where a prim is: local to world, 16 numbers, row-major, for column vectors.

    Raises:
        StageError: If there is no such prim.
    """
    raise NotImplementedError
