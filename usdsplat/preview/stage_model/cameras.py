"""Cameras of a stage, and a new one that sees what a viewport sees."""

from __future__ import annotations

from pxr import Usd

from usdsplat.delegate.specs import CameraSpec
from usdsplat.preview.stage_model.edits import Edits


def cameras(stage: Usd.Stage) -> tuple[str, ...]:
    """Paths of the stage's cameras, those in instances too, in the order of the stage."""
    raise NotImplementedError


def save_camera(edits: Edits, spec: CameraSpec, *, name: str = "Camera") -> str:
    """Author a camera that sees what `spec` sees, on the session layer; returns its path.

    Args:
        edits: Of the stage.
        spec: Such as `Picture.camera`.
        name: Of the prim below the stage's default prim; a number is added where it is taken.

    Raises:
        UsageError: If it is no name of a prim.
    """
    raise NotImplementedError
