"""Random edits of the metadata that makes prims assets."""

from __future__ import annotations

from pxr import Usd

KINDS = ("component", "component", "subcomponent", "group", "")


class AssetEdits:
    """The part of an `Editor` that changes kinds and asset information."""

    def set_kind(self) -> None:
        if prim := self._prim():
            Usd.ModelAPI(prim).SetKind(self._random.choice(KINDS))

    def set_asset_name(self) -> None:
        if prim := self._prim():
            Usd.ModelAPI(prim).SetAssetName(self._random.choice(["Some", "Other", ""]))

    def set_no_asset_info(self) -> None:
        if prim := self._prim(lambda each: each.HasAuthoredAssetInfo()):
            prim.ClearAssetInfo()
