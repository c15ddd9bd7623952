"""Define the options for opening a stage, shared by all commands that open one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from usdsplat.cli.arguments import option


@dataclass(frozen=True, slots=True, kw_only=True)
class StageOptions:
    """Options for opening a stage, named as in usdview and husk."""

    variant: Annotated[tuple[str, ...], option("/PRIM:SET=NAME")] = ()
    """select a variant; may be repeated"""
    mute: Annotated[tuple[str, ...], option("LAYER")] = ()
    """mute layers if this regular expression matches part of their identifier; may be repeated"""
    mask: Annotated[tuple[str, ...], option("/PRIM")] = ()
    """load only this prim, the prims below it and those that it refers to; may be repeated"""
    session_layer: Annotated[Path | None, option("FILE")] = None
    """layer with opinions stronger than the stage's own; neither file is changed"""
