"""Save opinions on a stage as a layer that has the stage's root layer as its sublayer."""

from __future__ import annotations

import os
from pathlib import Path

from pxr import Sdf, Usd

from usdsplat.core.readable import check_referable
from usdsplat.interchange.files import save

ROOT_METADATA = (
    "defaultPrim", "upAxis", "metersPerUnit", "kilogramsPerUnit", "timeCodesPerSecond",
    "framesPerSecond", "framePrecision", "startTimeCode", "endTimeCode", "colorManagementSystem",
    "colorConfiguration", "renderSettingsPrimPath", "fallbackPrimTypes",
)  # fmt: skip
"""Metadata that USD reads from the root layer only. The new root layer must repeat it."""


def save_over(opinions: Sdf.Layer, stage: Usd.Stage, target: Path) -> None:
    """Save opinions as a separate layer over the stage's root layer.

    Args:
        opinions: Layer of the opinions, which is not changed; the stage may use it.
        stage: The stage, whose layers are not changed.
        target: File to write, .usda, .usdc or .usd.

    Raises:
        OutputError: If the target cannot be written, or cannot refer to the stage.
    """
    root = stage.GetRootLayer()
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(opinions)
    for key in ROOT_METADATA:
        if root.pseudoRoot.HasInfo(key):
            layer.pseudoRoot.SetInfo(key, root.pseudoRoot.GetInfo(key))
    folder = os.path.realpath(target.parent)
    check_referable(root.realPath, folder)
    path = os.path.relpath(root.realPath, folder)
    layer.subLayerPaths.append(Path(path).as_posix() if path[0] == "." else f"./{path}")
    save(layer, target)
