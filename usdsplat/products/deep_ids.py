"""Make the ids and Cryptomattes of deep samples, as files have them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.delegate.engine import Engine
from usdsplat.images.aovs import AOVS
from usdsplat.images.cryptomatte import object_hash
from usdsplat.images.deep_aovs import CRYPTOMATTES
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
        self._aovs = tuple(name for name in plan.aovs if name not in ("color", "Z"))
        self._alpha = np.float32 if plan.pixel_type == "float" else np.float16
        paths = engine.stage_info().prims if "id" in self._aovs else ()
        self._numbers = {path: number for number, path in enumerate(paths)}

    def channels(self, samples: DeepSamples) -> dict[str, npt.NDArray[Any]]:
        """Return the values of the channels of ids and Cryptomattes, by channel."""
        found: dict[str, npt.NDArray[Any]] = {}
        columns = dict(zip(samples.id_names, samples.ids.T, strict=True)) if self._aovs else {}
        for name in self._aovs:
            aov = AOVS[name]
            if name in CRYPTOMATTES:
                hashes = np.array([object_hash(path) for path in samples.prims], np.float32)
                zero = np.zeros(len(samples.depth), np.float32)
                # The coverage is A as it is stored, so that both flatten to the same.
                coverage = samples.color[:, 3].astype(self._alpha).astype(np.float32)
                ranks = hashes[columns["primId"]], coverage, zero, zero
                found |= zip(aov.channels[:4], ranks, strict=True)
            elif name == "id":
                numbers = np.array([self._numbers[path] for path in samples.prims], np.uint32)
                found["id"] = numbers[columns["primId"]]
            else:
                found[aov.channels[0]] = np.ascontiguousarray(columns[aov.hydra]).view(np.uint32)
        return found
