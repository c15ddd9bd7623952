"""Read a USD stage for the delegate; the only part of it that imports `pxr`.

There is one module per kind of prim; `delegate` combines them and turns USD's notices into dirty
bits.
"""

from __future__ import annotations

from typing import TypeAlias

from pxr import Usd

from usdsplat.delegate.scene_delegate.delegate import UsdSceneDelegate
from usdsplat.delegate.scene_delegate.render_products import find_products, read_products

Stage: TypeAlias = Usd.Stage

__all__ = ["Stage", "UsdSceneDelegate", "find_products", "read_products"]
