"""Find the files of a stage and of its value clips, which USD opens only when their values are
read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Ar, Sdf, Tf, Usd

from usdsplat.schema.stage_values import in_world


def clip_assets(prims: Iterable[Usd.Prim]) -> Iterator[tuple[Usd.Prim, Sdf.AssetPath]]:
    """Yield (prim, asset) of each clip and manifest of prims; resolved, or with an empty
    `resolvedPath` if the file is missing."""
    for prim in filter(has_clips, prims):
        api = Usd.ClipsAPI(prim)
        for name in api.GetClips() or {}:
            try:
                found = list(api.ComputeClipAssetPaths(name) or ())
                manifest = api.GetClipManifestAssetPath(name)
            except (Tf.ErrorException, TypeError):  # metadata of another type
                continue
            for asset in (*found, *([manifest] if manifest and manifest.path else [])):
                yield prim, asset


def has_clips(prim: Usd.Prim) -> bool:
    """Return whether a prim has metadata of value clips."""
    return bool(prim.HasAuthoredMetadata("clips"))


def clipped_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return the prims of a stage that have value clips.

    The layers that USD uses tell nothing: it opens clips when their values are read, and a manifest
    may be a layer of the stage as well.
    """
    return list(filter(has_clips, in_world(stage)))


class ClippedPrims:
    """The prims of a stage that have value clips, which are looked for once."""

    def __init__(self) -> None:
        self._found: list[Usd.Prim] | None = None

    def of(self, stage: Usd.Stage) -> list[Usd.Prim]:
        """Return those of the stage, which is the same in each call."""
        if self._found is None:
            self._found = clipped_prims(stage)
        return self._found


def clip_files(prims: Iterable[Usd.Prim]) -> set[str]:
    """Return the files of the value clips of prims that exist, packages included."""
    found = (asset.resolvedPath for _, asset in clip_assets(prims))
    return {file_of(path) for path in found if path}


def layers_without_clips(stage: Usd.Stage) -> list[Sdf.Layer]:
    """Return the layers that a stage uses, whatever was read from it: value clips are among USD's
    used layers only once they are open."""
    return list(stage.GetUsedLayers(False))


def stage_files(stage: Usd.Stage) -> set[str]:
    """Return the files that a stage reads: its layers, its value clips, packages included."""
    paths = (layer.realPath for layer in layers_without_clips(stage))
    return {file_of(path) for path in paths if path} | clip_files(clipped_prims(stage))


def file_of(path: str) -> str:
    """Return the file of a layer: for a layer inside a package, the outermost package."""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])
