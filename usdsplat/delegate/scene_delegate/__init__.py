"""What the delegate asks of a USD stage; the only part of it that knows `pxr`.

One module per kind of prim; `delegate` answers for all of them and turns USD's notices into dirty
bits.
"""

from __future__ import annotations

from typing import TypeAlias

from pxr import Usd

from usdsplat.delegate.scene_delegate.delegate import UsdSceneDelegate
from usdsplat.delegate.scene_delegate.render_products import find_products

Stage: TypeAlias = Usd.Stage

__all__ = ["Stage", "UsdSceneDelegate", "find_products"]
