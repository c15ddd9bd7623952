"""Find the files of value clips, which are no layers of a stage until their frames are read."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Usd

from usdsplat.schema.stage_values import in_world


def clip_assets(stage: Usd.Stage) -> Iterator[tuple[Usd.Prim, Sdf.AssetPath]]:
    """Yield each clip and each manifest of a stage with the prim that has it.

    The path of an asset that does not exist is not resolved. Of a template, USD lists only the
    clips that exist.
    """
    for prim in in_world(stage):
        if not prim.HasAuthoredMetadata("clips"):
            continue
        clips = Usd.ClipsAPI(prim)
        for name in clips.GetClips():
            manifest = clips.GetClipManifestAssetPath(name)
            if manifest is not None and manifest.path:
                yield prim, manifest
            for asset in clips.ComputeClipAssetPaths(name):
                yield prim, asset
