"""The options that say how a stage is opened, the same for every command that opens one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import UseAppendAction, arg


@dataclass(frozen=True, slots=True, kw_only=True)
class StageOptions:
    """As in usdview and husk."""

    variant: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="/PRIM:SET=NAME")] = ()
    """choose a variant; may be given several times"""
    mute: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="LAYER")] = ()
    """leave out layers whose identifier has this in it, a regular expression; may be repeated"""
    mask: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="/PRIM")] = ()
    """load nothing but this prim, what is below it and what it refers to; may be repeated"""
    session_layer: Annotated[Path | None, arg(metavar="FILE")] = None
    """a layer of opinions stronger than the stage's own; neither is ever written to"""
