"""The AOVs of one band of one sample: splats, what is behind them, and one over the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.delegate.layer import Behind, Layer
from usdsplat.delegate.motion import Motion
from usdsplat.delegate.plain import PlainSplats
from usdsplat.delegate.shot import Prepared, Shot
from usdsplat.delegate.sums import Sums
from usdsplat.delegate.surfaces import SurfaceBand
from usdsplat.kernels import feature, position, surface

AVERAGED = ("color", "albedo", "cryptoObject")
"""What is averaged over samples; nothing else may be mixed."""


class Painter:
    """Draws bands of one picture."""

    def __init__(self, shot: Shot) -> None:
        self._shot = shot

    def draw(
        self,
        prepared: Prepared,
        motion: Motion | None,
        y0: int,
        y1: int,
        aovs: tuple[str, ...],
        *,
        raw: bool = False,
    ) -> dict[str, npt.NDArray[Any]]:
        """One band of one sample: arrays of the device; `raw` mattes are (ids, weights), to be
        summed."""
        if isinstance(prepared.seen, PlainSplats):
            return {"color": self._finish(prepared.seen.rows(y0, y1), None, None)}
        layer, behind, drawn = self._shot.layer(prepared, y0, y1)
        color, through = layer.color()
        self._shot.clock.lap("blend")
        left = None if drawn is None else self._left(color, through, behind)
        wanted = set(aovs)
        arrays: dict[str, npt.NDArray[Any]] = {}
        if wanted - set(AVERAGED) - {"Neye", "depthExpected", "depthFront"}:
            arrays |= self._nearest(layer, behind, drawn, "median", 0.5)
            arrays |= self._places(prepared, motion, arrays, drawn, y0, wanted)
        if "depthFront" in wanted:
            front = self._nearest(layer, behind, drawn, "front", 0.0)
            arrays["depthFront"] = front["depth"]
        if wanted & {"Neye", "depthExpected", "albedo"}:
            arrays |= self._features(layer, left, drawn, wanted)
        if "cryptoObject" in wanted:
            arrays["cryptoObject"] = self._mattes(prepared, layer, left, drawn, raw=raw)
        if "color" in wanted:
            arrays["color"] = self._finish(color, left, None if drawn is None else drawn.color)
        return arrays

    def _left(self, color: F32, through: F32 | None, behind: Behind) -> F32:
        """What the splats let through of the surfaces behind them."""
        left = self._shot.scratch.get("left", color.shape[:2], np.float32)
        nothing = np.empty((0, 0), np.float32)
        self._shot.device.run(
            surface.show_through, color, nothing if through is None else through, behind.covered,
            behind.stops, behind.holdout, left,
        )  # fmt: skip
        return left

    def _finish(
        self, layer: F32, left: F32 | None, behind: F32 | None, *, counts: bool = True
    ) -> F32:
        """A layer in the picture's space, over what it lets through."""
        image = self._shot.output.splats(layer, counts=counts)
        if left is not None and behind is not None:
            self._shot.device.run(surface.over, image, left, self._shot.output.surfaces(behind))
        self._shot.clock.lap("output")
        return image

    def _nearest(
        self,
        layer: Layer,
        behind: Behind,
        drawn: SurfaceBand | None,
        name: str,
        part: float,
    ) -> dict[str, npt.NDArray[Any]]:
        """Depth and identity of what passes a part of the coverage, surfaces included."""
        depth, ids = layer.median(name, part)
        if drawn is not None:
            run = self._shot.device.run
            run(surface.nearest, depth, ids, behind.stops, behind.covered, drawn.ids)
        self._shot.clock.lap("median")
        return {
            "depth": depth,
            "primId": ids[0],
            "instanceId": ids[1],
            "elementId": ids[2],
            "row": ids[3],
        }

    def _places(
        self,
        prepared: Prepared,
        motion: Motion | None,
        median: dict[str, npt.NDArray[Any]],
        drawn: SurfaceBand | None,
        y0: int,
        wanted: set[str],
    ) -> dict[str, npt.NDArray[Any]]:
        """Positions and motion of the median surface."""
        arrays: dict[str, npt.NDArray[Any]] = {}
        depth, x0 = median["depth"], prepared.screen.window[0]
        if "P" in wanted:
            arrays["P"] = self._shot.scratch.get("P", (*depth.shape, 3), np.float32)
            self._shot.device.run(
                position.positions, prepared.screen.view_record(),
                np.ascontiguousarray(np.linalg.inv(prepared.screen.world_to_camera)[:3]), depth,
                x0, y0, arrays["P"],
            )  # fmt: skip
        if motion is not None:
            arrays |= motion.draw(
                self._shot.device, self._shot.scratch, median, drawn, x0, y0, wanted
            )
        self._shot.clock.lap("places")
        return arrays

    def _features(
        self,
        layer: Layer,
        left: F32 | None,
        drawn: SurfaceBand | None,
        wanted: set[str],
    ) -> dict[str, npt.NDArray[Any]]:
        """What is averaged over all contributions of a pixel."""
        arrays: dict[str, npt.NDArray[Any]] = {}
        get, run = self._shot.scratch.get, self._shot.device.run
        if "albedo" in wanted:
            image = layer.paint("albedo", feature.ALBEDO)
            behind = None if drawn is None else drawn.albedo
            arrays["albedo"] = self._finish(image, left, behind, counts=False)
        if "Neye" in wanted:
            sums = layer.paint("normals", feature.NORMAL)
            arrays["Neye"] = get("Neye", (*sums.shape[:2], 3), np.float32)
            none = np.empty((0, 0, 3), np.float32)
            run(
                feature.unit, sums, none if drawn is None else drawn.normal,
                none[..., 0] if left is None else left, arrays["Neye"],
            )  # fmt: skip
        if "depthExpected" in wanted:
            sums = layer.depths()
            arrays["depthExpected"] = get("Zexp", sums.shape[:2], np.float32)
            nothing = np.empty((0, 0), np.float32)
            run(
                feature.expected, sums, nothing if left is None else left,
                nothing if drawn is None else drawn.depth, arrays["depthExpected"],
            )  # fmt: skip
        self._shot.clock.lap("features")
        return arrays

    def _mattes(
        self,
        prepared: Prepared,
        layer: Layer,
        left: F32 | None,
        drawn: SurfaceBand | None,
        *,
        raw: bool,
    ) -> Any:
        """How much each prim covers of each pixel."""
        found = [layer.weigh()]
        if left is not None and drawn is not None:
            prims = self._shot.scratch.get("shown", left.shape, np.int32)
            self._shot.device.run(surface.shown, left, drawn.ids, prims)
            found.append((prims.reshape((*left.shape, 1)), left.reshape((*left.shape, 1))))
        self._shot.clock.lap("mattes")
        if raw:
            return found
        sums = Sums(self._shot.device, self._shot.scratch, layer.shape, ("cryptoObject",))
        sums.add({"cryptoObject": found}, prepared.seen.layout.prims)
        return sums.finish()["cryptoObject"]
