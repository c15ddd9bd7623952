"""Find the files of value clips, which USD opens only when their values are read."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Tf, Usd


def clip_assets(stage: Usd.Stage) -> Iterator[tuple[Usd.Prim, Sdf.AssetPath]]:
    """Yield (prim, asset) of each clip and manifest of a stage; resolved, or with an empty
    `resolvedPath` if the file is missing."""
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if not prim.HasAuthoredMetadata("clips"):
            continue
        api = Usd.ClipsAPI(prim)
        for name in api.GetClips() or {}:
            try:
                found = list(api.ComputeClipAssetPaths(name) or ())
                manifest = api.GetClipManifestAssetPath(name)
            except (Tf.ErrorException, TypeError):  # metadata of another type
                continue
            for asset in (*found, *([manifest] if manifest and manifest.path else [])):
                yield prim, asset


def clip_files(stage: Usd.Stage) -> set[str]:
    """Return the files of the value clips of a stage that exist."""
    return {asset.resolvedPath for _, asset in clip_assets(stage) if asset.resolvedPath}
