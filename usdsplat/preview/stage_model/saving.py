"""What a user made of a stage, written to files of its own; never over those of the stage."""

from __future__ import annotations

from pathlib import Path

from pxr import Usd

from usdsplat.delegate.specs import CameraSpec


def save_session(stage: Usd.Stage, target: Path) -> None:
    """Write the user's edits as a layer to stack over the stage; a running simulation's stay out.

    Raises:
        UnknownFormatError: If the suffix is none of USD's.
        OutputError: If it cannot be written, or the stage is made of that file.
    """
    raise NotImplementedError


def save_camera_layer(
    stage: Usd.Stage, spec: CameraSpec, target: Path, *, name: str = "Camera"
) -> str:
    """Write a layer with nothing but a camera, to stack over the stage; returns its path there.

    Raises:
        UsageError: If `name` is no name of a prim.
        UnknownFormatError: If the suffix is none of USD's.
        OutputError: If it cannot be written, or the stage is made of that file.
    """
    raise NotImplementedError
