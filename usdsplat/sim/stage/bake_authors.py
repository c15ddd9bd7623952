"""Authors of the samples of a field, one for each mode of a bake."""

from __future__ import annotations

from typing import Protocol

from pxr import Usd

from usdsplat.sim.parameters import BakeParameters
from usdsplat.sim.stage.bake_dense import DenseAuthor
from usdsplat.sim.stage.bake_edit import EditAuthor
from usdsplat.sim.stage.bake_packed import PackedAuthor
from usdsplat.sim.stage.epochs import Sample
from usdsplat.sim.stage.plan import Plan
from usdsplat.sim.stage.sample_layer import SampleLayer


class Author(Protocol):
    """Author of one field."""

    def write(self, part: SampleLayer, sample: Sample) -> None:
        """Add a sample to a part."""


def author_of(stage: Usd.Stage, plan: Plan, parameters: BakeParameters, first: float) -> Author:
    """Return the author of a field in this mode."""
    if parameters.mode == "edit":
        return EditAuthor(plan, first)
    if plan.is_packed:
        return PackedAuthor(plan, stage.GetPrimAtPath(plan.path))
    return DenseAuthor(plan)
