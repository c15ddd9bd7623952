"""Find the files of a stage and of its value clips, which USD opens only when their values are
read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Ar, Sdf, Tf, Usd

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
    """Return the files of the value clips of a stage that exist, packages included."""
    if len(stage.GetUsedLayers()) == len(stage.GetUsedLayers(False)):
        return set()  # without a search: each set of clips uses a layer, at least its manifest
    assets = (asset for _, asset in clip_assets(in_world(stage)))
    found = (asset.resolvedPath for asset in assets if asset.resolvedPath)
    return set(map(file_of, found))


def layers_without_clips(stage: Usd.Stage) -> list[Sdf.Layer]:
    """Return the layers that a stage uses, whatever was read from it: value clips are among USD's
    used layers only once they are open."""
    return list(stage.GetUsedLayers(False))


def stage_files(stage: Usd.Stage) -> set[str]:
    """Return the files that a stage reads: its layers, its value clips, packages included."""
    paths = (layer.realPath for layer in layers_without_clips(stage))
    return {file_of(path) for path in paths if path} | clip_files(stage)


def file_of(path: str) -> str:
    """Return the file of a layer: for a layer inside a package, the outermost package."""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])
