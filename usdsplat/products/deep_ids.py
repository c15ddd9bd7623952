"""Make the ids and Cryptomattes of deep samples, as files have them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.delegate.engine import Engine
from usdsplat.images.aovs import AOVS
from usdsplat.images.cryptomatte import object_hash
from usdsplat.images.deep_aovs import ALWAYS, CRYPTOMATTES
from usdsplat.products.request import PicturePlan
from usdsplat.render.deep_samples import DEEP_IDS, DeepSamples


def deep_ids(aovs: tuple[str, ...]) -> tuple[str, ...]:
    """Return the ids that the renderer must find for the AOVs of a deep picture."""
    wanted = {"primId" if name in CRYPTOMATTES else AOVS[name].hydra for name in aovs}
    return tuple(name for name in DEEP_IDS if name in wanted)


class DeepIds:
    """Ids of the deep samples of one picture, in the numbers of its file.

    Args:
        engine: Engine at the picture's time.
        plan: Plan of the picture.
    """

    def __init__(self, engine: Engine, plan: PicturePlan) -> None:
        self._aovs = tuple(name for name in plan.aovs if name not in ALWAYS)
        self._alpha = np.float32 if plan.pixel_type == "float" else np.float16
        paths = engine.stage_info().prims if "id" in self._aovs else ()
        self._numbers = {path: number for number, path in enumerate(paths)}
        self._prims: tuple[str, ...] = ()
        self._tables: dict[str, npt.NDArray[Any]] = {}

    def channels(self, samples: DeepSamples) -> dict[str, npt.NDArray[Any]]:
        """Return the values of the channels of ids and Cryptomattes, by channel."""
        found: dict[str, npt.NDArray[Any]] = {}
        tables = self._tables_of(samples.prims)
        columns = dict(zip(samples.id_names, samples.ids.T, strict=True)) if self._aovs else {}
        for name in self._aovs:
            aov = AOVS[name]
            if name in CRYPTOMATTES:
                zero = np.zeros(len(samples.depth), np.float32)
                # The coverage is A as it is stored, so that both flatten to the same.
                coverage = samples.color[:, 3].astype(self._alpha).astype(np.float32)
                ranks = tables[name][columns["primId"]], coverage, zero, zero
                found |= zip(aov.channels[:4], ranks, strict=True)
            elif name == "id":
                found["id"] = tables[name][columns["primId"]]
            else:
                found[aov.channels[0]] = np.ascontiguousarray(columns[aov.hydra]).view(np.uint32)
        return found

    def _tables_of(self, prims: tuple[str, ...]) -> dict[str, npt.NDArray[Any]]:
        """Return the value of each prim, by AOV. Strips of a picture have the same ones."""
        if prims != self._prims:
            self._prims = prims
            self._tables = {
                name: np.array([object_hash(path) for path in prims], np.float32)
                if name in CRYPTOMATTES
                else np.array([self._numbers[path] for path in prims], np.uint32)
                for name in self._aovs
                if name == "id" or name in CRYPTOMATTES
            }
        return self._tables
