"""Find the files of value clips, which USD opens only when their values are read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Sdf, Tf, Usd

from usdsplat.schema.stage_values import in_world


def clip_assets(prims: Iterable[Usd.Prim]) -> Iterator[tuple[Usd.Prim, Sdf.AssetPath]]:
    """Yield (prim, asset) of each clip and manifest of prims; resolved, or with an empty
    `resolvedPath` if the file is missing."""
    for prim in prims:
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
    if len(stage.GetUsedLayers()) == len(stage.GetUsedLayers(False)):
        return set()  # without a search: each set of clips uses a layer, at least its manifest
    return {asset.resolvedPath for _, asset in clip_assets(in_world(stage)) if asset.resolvedPath}
