"""The options that say how a stage is opened, the same for every command that opens one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from usdsplat.cli.arguments import option


@dataclass(frozen=True, slots=True, kw_only=True)
class StageOptions:
    """As in usdview and husk."""

    variant: Annotated[tuple[str, ...], option("/PRIM:SET=NAME")] = ()
    """choose a variant; may be repeated"""
    mute: Annotated[tuple[str, ...], option("LAYER")] = ()
    """leave out layers whose identifier has this in it, a regular expression; may be repeated"""
    mask: Annotated[tuple[str, ...], option("/PRIM")] = ()
    """load nothing but this prim, what is below it and what it refers to; may be repeated"""
    session_layer: Annotated[Path | None, option("FILE")] = None
    """a layer of opinions stronger than the stage's own; neither is ever written to"""
