"""Write a sequence as value clips: a file for each frame in a folder beside the stage.

The stage maps times to files by relative paths; `topology.usda` holds constant data and
`manifest.usda` the varying attributes. Applications open a frame's file when they need it.

Source: "Value Clips" in the documentation of UsdClipsAPI.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from pxr import Sdf, Usd, UsdUtils, Vt

from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.output import OutputFile
from usdsplat.images.frame_numbers import frame_path
from usdsplat.interchange.authoring import prepare
from usdsplat.schema.stage_values import stage_unit, up_axis
from usdsplat.schema.usd_files import new_layer, save_layer, usd_errors

_TOPOLOGY = "topology.usda"
_MANIFEST = "manifest.usda"
_OURS = re.compile(r"frame\.-?[\d.]+\.usdc|topology\.usda|manifest\.usda")


class Clips:
    """The value clips of one field, in a folder beside the stage's file."""

    def __init__(self, stage: Usd.Stage, folder: Path, output: OutputFile) -> None:
        """
        Args:
            stage: Stage that refers to the clips; its root layer is in the folder's parent.
            folder: Folder of the clips; it is created here.
            output: The stage's file, in whose private folder this folder is.
        """
        folder.mkdir()
        self._output = output
        self._stage = stage
        self._folder = folder
        self._files: dict[float, Path] = {}

    @staticmethod
    def folder_of(target: Path) -> Path:
        """Return the folder of the clips of a stage's file: `shot.clips` for `shot.usdc`.

        Raises:
            UsageError: If the target is a package, which cannot refer to a folder.
            OutputError: If the folder exists with other content.
        """
        if target.suffix.lower() == ".usdz":
            raise UsageError("clips", "a .usdz target", "a .usd, .usda or .usdc file")
        final = Path(os.path.realpath(target))
        folder = final.with_name(f"{target.stem}.clips")
        if os.path.lexists(folder):
            is_folder = folder.is_dir() and not folder.is_symlink()
            if not is_folder or not all(_OURS.fullmatch(name) for name in os.listdir(folder)):
                found = "something that is not a folder of clips"
                raise OutputError(str(folder), found, "earlier clips or nothing")
        return folder

    def new(self, time: float) -> Usd.Stage:
        """Create an empty stage for a frame, which can be opened by itself."""
        is_whole = time == int(time)
        path = frame_path(
            self._folder / f"frame.{'####' if is_whole else '####.######'}.usdc", time
        )
        stage = Usd.Stage.Open(new_layer(path, self._output))
        unit = stage_unit(self._stage)
        prepare(stage, up_axis(self._stage), unit)
        stage.SetStartTimeCode(time)
        stage.SetEndTimeCode(time)
        stage.SetTimeCodesPerSecond(self._stage.GetTimeCodesPerSecond())
        self._files[time] = path
        return stage

    def finish(self, where: Sdf.Path) -> None:
        """Author the references to the clips, which all have the field at `where`.

        They belong to the prim above the field, so that they include the field's proxy.
        """
        if not where.IsRootPrimPath():
            where = where.GetParentPath()
        first = str(next(iter(self._files.values())))
        topology = new_layer(self._folder / _TOPOLOGY, self._output)
        with usd_errors(self._output.target):  # this and the next function save the layer, too
            UsdUtils.StitchClipsTopology(topology, [first])
        for key in ("startTimeCode", "endTimeCode"):  # those of the first clip
            topology.pseudoRoot.ClearInfo(key)
        save_layer(topology, self._output)
        manifest = new_layer(self._folder / _MANIFEST, self._output)
        with usd_errors(self._output.target):
            UsdUtils.StitchClipsManifest(manifest, topology, [first], str(where))
        save_layer(manifest, self._output)
        root = self._stage.GetRootLayer()
        root.subLayerPaths.append(self._asset(_TOPOLOGY))
        for key in ("defaultPrim", "fallbackPrimTypes"):  # ineffective in a sublayer
            if topology.pseudoRoot.HasInfo(key):
                root.pseudoRoot.SetInfo(key, topology.pseudoRoot.GetInfo(key))
        times = list(self._files)
        clips = Usd.ClipsAPI(self._stage.OverridePrim(where))
        clips.SetClipPrimPath(str(where))
        clips.SetClipAssetPaths(
            Sdf.AssetPathArray([Sdf.AssetPath(self._asset(p.name)) for p in self._files.values()])
        )
        clips.SetClipActive(Vt.Vec2dArray([(time, i) for i, time in enumerate(times)]))
        clips.SetClipTimes(Vt.Vec2dArray([(time, time) for time in times]))
        clips.SetClipManifestAssetPath(Sdf.AssetPath(self._asset(_MANIFEST)))

    def _asset(self, name: str) -> str:
        """Return the asset path of a file in the folder."""
        return f"./{self._folder.name}/{name}"
