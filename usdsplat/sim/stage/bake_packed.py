"""Author samples as our packed type: the layer retypes the prim, and the capture's arrays are
ignored."""

from __future__ import annotations

from dataclasses import replace

from pxr import Sdf, Usd

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.schema import packed, packing, proxy, tokens
from usdsplat.sim.stage.bake_dense import common
from usdsplat.sim.stage.epochs import Sample
from usdsplat.sim.stage.plan import Plan
from usdsplat.sim.stage.sample_layer import SampleLayer


class PackedAuthor:
    """Author of one field."""

    def __init__(self, plan: Plan, field: Usd.Prim) -> None:
        """
        Args:
            plan: What to write.
            field: The field on the simulated stage, with the transform of its proxy.
        """
        self._plan = plan
        self._field = field
        self._sh: F32 | None = None
        self._packed: packing.PackedArrays | None = None

    def write(self, part: SampleLayer, sample: Sample) -> None:
        """Add a sample to a part."""
        plan = self._plan
        if sample.sh is not None:
            self._sh = sample.sh
        cloud = _cloud(sample, self._sh)
        arrays = self._pack(cloud, is_new=sample.sh is not None)
        stage = Usd.Stage.Open(part.layer)  # a reference, which the prim needs
        prim = stage.OverridePrim(plan.path)
        prim.SetTypeName(tokens.PACKED_TYPE)
        code = Usd.TimeCode(sample.time)
        packed.author(prim, cloud.positions, arrays, code=code)
        self._author_proxy(part, prim, cloud, code)
        if not plan.is_imageable:
            prim.RemoveProperty(tokens.PURPOSE)
        common(part, plan, sample)

    def _author_proxy(
        self, part: SampleLayer, prim: Usd.Prim, cloud: SplatCloud, code: Usd.TimeCode
    ) -> None:
        """Write the points beside the field, and hide those that 0.6 wrote below it."""
        if self._plan.proxy is None:
            return
        path = Sdf.Path(self._plan.proxy)
        is_first = not part.layer.GetPrimAtPath(path)
        points = proxy.author(prim, path, cloud, code=code)
        if is_first:
            proxy.place(self._field, points)
            if child := proxy.child_of(self._field):
                part.prim(str(child.GetPath())).active = False

    def _pack(self, cloud: SplatCloud, *, is_new: bool) -> packing.PackedArrays:
        """Pack a cloud; harmonics above degree 0 only if they are new."""
        if is_new or self._packed is None:
            self._packed = packing.pack(cloud)
            return self._packed
        core = packing.pack(replace(cloud, sh=cloud.sh[:, :1]))
        return replace(self._packed, core=core.core, color_range=core.color_range)


def _cloud(sample: Sample, sh: F32 | None) -> SplatCloud:
    """Return the cloud of a sample. No array is missing: this mode writes all of them, and each
    epoch starts with harmonics."""
    positions, rotations = sample.positions, sample.rotations
    scales, opacities = sample.scales, sample.opacities
    assert positions is not None and rotations is not None
    assert scales is not None and opacities is not None and sh is not None
    return SplatCloud(
        positions=positions, rotations=rotations, scales=scales, opacities=opacities, sh=sh
    )
