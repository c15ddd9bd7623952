"""Compute the AOVs of one band of one sample from its tile lists and surfaces."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.images.aovs import CAPTURED, is_light
from usdsplat.images.cryptomatte import LAYERS, rank_pairs
from usdsplat.kernels import cryptomatte, feature, light_parts, position, receivers, surface, total
from usdsplat.kernels import median as median_kernels
from usdsplat.render.frame_context import FrameContext, FrameSample
from usdsplat.render.lights.needs import LightRequest
from usdsplat.render.matte_groups import MatteGroups
from usdsplat.render.motion import Motion
from usdsplat.render.occluders import Occluders
from usdsplat.render.projected_splats import ProjectedSplats
from usdsplat.render.surfaces import SurfaceBand
from usdsplat.render.tile_lists import TileLists

AVERAGED = ("color", "albedo", "shadow", "irradiance", *LAYERS)
"""AOVs that are averaged over samples, like those of light groups. Averages of others, such as ids,
have no meaning."""
SURFACE = {"Neye", "confidence", "occlusion"}
"""AOVs for which the normals of surfaces are needed."""
SUMMED = {*SURFACE, "Naxis", "depthExpected", "albedo"}
"""AOVs that are sums of a feature over all contributions of a pixel."""


BESIDE_MEDIAN = {*AVERAGED, *SUMMED, "depthFront"}
"""AOVs that do not depend on the median splat."""
PRODUCT = {
    "albedo": "albedo",
    "Neye": "normals",
    "Naxis": "axes",
    "depthExpected": "depths",
    "confidence": "depths",
    "occlusion": "depths",
    "depthFront": "front",
}
"""AOV -> the product it is computed from, see `tile_lists.PRODUCTS`. Layers of Cryptomatte are
requested separately."""


def is_averaged(aov: str) -> bool:
    """Return whether an AOV is averaged over the samples of a picture."""
    return aov in AVERAGED or is_light(aov)


def needs_median(aovs: AbstractSet[str]) -> bool:
    """Return whether AOVs depend on the median splat."""
    return not all(name in BESIDE_MEDIAN or is_light(name) for name in aovs)


def products_of(aovs: set[str]) -> frozenset[str]:
    """Return the products that must be drawn in addition to colour."""
    products = {PRODUCT[name] for name in aovs if name in PRODUCT}
    return frozenset(products | ({"median"} if needs_median(aovs) else set()))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SplatLayers:
    """Layers of splats of a band in the blend space, as arrays of the device."""

    color: F32
    """Premultiplied RGBA, shape (h, w, 4)."""
    albedo: F32 | None
    """The same of the albedo; None if it is not needed."""
    left: F32 | None
    """Transmittance to the surfaces, shape (h, w); None without surfaces."""
    lights: F32 | None = None
    """The part of `color` by each light group, shape (parts * h, w, 4); None if not requested."""


class AovResolver:
    """Rasterizer of one band's splats, which composites them over the band's surfaces.

    Args:
        surfaces: The band's surfaces; None if there are none.
    """

    def __init__(
        self,
        frame: FrameContext,
        sample: FrameSample,
        tiles: TileLists,
        occluders: Occluders,
        surfaces: SurfaceBand | None,
    ) -> None:
        self._frame, self._sample = frame, sample
        self._tiles, self._occluders, self._surfaces = tiles, occluders, surfaces
        self._run, self._buffers = frame.device.run, frame.buffers.pixels

    def resolve(
        self, aovs: tuple[str, ...], motion: Motion | None, y0: int, *, raw: bool
    ) -> dict[str, Any]:
        """Return AOVs as arrays of the device.

        Args:
            motion: Motion to the neighbouring frames; None if no AOV needs it.
            y0: First row of the band.
            raw: Whether Cryptomattes are returned as (groups, weights), for accumulation.
        """
        wanted, surfaces = set(aovs), self._surfaces
        mattes = {layer: groups for layer, groups in self._sample.groups.items() if layer in wanted}
        rank = self._frame.settings.crypto_rank
        color, through = self._tiles.color(products_of(wanted), mattes, rank)
        self._frame.clock.lap("blend")
        left = None if surfaces is None else self._left(color, through)
        arrays: dict[str, Any] = {}
        if needs_median(wanted):
            arrays |= self._nearest("median")
            arrays |= self._places(arrays, motion, y0, wanted)
            self._number_elements(arrays)  # motion needs rows of the fields
        if "depthFront" in wanted:
            arrays["depthFront"] = self._nearest("front")["depth"]
        if wanted & SUMMED:
            arrays |= self._features(left, wanted)
        arrays |= self.light_means(wanted, left)
        if parts := LightRequest.of(aovs).parts:
            layers = self._light_layers(parts, color)
            arrays |= composited_parts(self._frame, parts, layers, left, surfaces)
        for layer, groups in mattes.items():
            arrays[layer] = self._matte(layer, groups, left, raw=raw)
        if "color" in wanted:
            behind = None if surfaces is None else surfaces.color
            arrays["color"] = composited(self._frame, color, left, behind)
        return arrays

    def layers(self, aovs: tuple[str, ...]) -> tuple[SplatLayers, dict[str, Any]]:
        """Return the layers of averaged AOVs before they are composited, and unranked mattes."""
        wanted = set(aovs)
        mattes = {layer: groups for layer, groups in self._sample.groups.items() if layer in wanted}
        rank = self._frame.settings.crypto_rank
        color, through = self._tiles.color(products_of(wanted), mattes, rank)
        self._frame.clock.lap("blend")
        left = None if self._surfaces is None else self._left(color, through)
        albedo = self._tiles.sums("albedo") if "albedo" in wanted else None
        parts = LightRequest.of(aovs).parts
        lights = self._light_layers(parts, color) if parts else None
        ranked = {
            layer: self._matte(layer, groups, left, raw=True) for layer, groups in mattes.items()
        }
        return SplatLayers(color=color, albedo=albedo, left=left, lights=lights), ranked

    def light_means(self, wanted: AbstractSet[str], left: F32 | None) -> dict[str, Any]:
        """Return those of the AOVs `shadow` and `irradiance` that are wanted, after colour.

        Args:
            left: Transmittance to the surfaces; None without surfaces.
        """
        found = {}
        if "shadow" in wanted:
            found["shadow"] = self._shadow(left)
        if "irradiance" in wanted:
            found["irradiance"] = self._irradiance(left)
        return found

    # --- private ---------------------------------------------------------------------------

    def _shadow(self, left: F32 | None) -> F32:
        """Return the ratio of light with and without shadows, shape (h, w, 3)."""
        out: F32 = self._buffers.shadow(*self._tiles.shape)
        lighting, shadows = self._sample.lighting, self._sample.shadows
        if lighting is None or shadows is None:
            self._run(receivers.no_shadow, out)
            return out
        splats = self._tiles.painted(*shadows)
        ratio, prims = np.empty((0, 3), np.float32), np.empty(0, np.int32)
        if self._surfaces is not None and self._surfaces.received is not None:
            ratio, prims = self._surfaces.received
        self._run(
            receivers.shadow, splats, np.empty((0, 0), np.float32) if left is None else left, ratio,
            prims, lighting.catching, lighting.has_catchers, out,
        )  # fmt: skip
        self._frame.clock.lap("shadow")
        return out

    def _irradiance(self, left: F32 | None) -> F32:
        """Return the mean light that arrives, in the working space, shape (h, w, 3)."""
        out: F32 = self._buffers.irradiance(*self._tiles.shape)
        paints, band = self._sample.paints, self._surfaces
        if paints is None or paints.lighting is None:
            self._run(total.clear, out)
            return out
        splats = self._tiles.painted(paints.arrivals())
        nothing = np.empty((0, 0), np.float32)
        shown, sums = (nothing, nothing)
        if left is not None and band is not None and band.light is not None:
            shown, sums = left, band.light.sums
        self._run(light_parts.mean_light, splats, shown, sums, out)
        self._frame.clock.lap("irradiance")
        return self._frame.output.light(out)

    def _light_layers(self, parts: tuple[str, ...], color: F32) -> F32:
        """Return the part of the splats' colours by each light group, see `SplatLayers`."""
        height, width = self._tiles.shape
        layers: F32 = self._buffers.lights(len(parts), height, width)
        self._run(total.clear, layers)
        paints = self._sample.paints
        assert paints is not None
        for k, name in enumerate(parts):
            if paints.is_lit(name):
                image = self._tiles.painted(paints.part(name)) if paints.is_divided else color
                self._run(total.add, layers[k * height : (k + 1) * height], image)
        self._frame.clock.lap("lights")
        return layers

    def _left(self, color: F32, through: F32 | None) -> F32:
        """Return the transmittance of the splats to the surfaces behind them, shape (h, w)."""
        left: F32 = self._buffers.left(*color.shape[:2])
        nothing = np.empty((0, 0), np.float32)
        self._run(
            surface.show_through, color, nothing if through is None else through,
            self._occluders.covered, self._occluders.depth, self._occluders.holdout, left,
        )  # fmt: skip
        return left

    def _nearest(self, name: str) -> dict[str, Any]:
        """Return depth and ids of "median" or "front", surfaces included."""
        depth, ids = self._tiles.median(name)
        if self._surfaces is not None:
            occluders = self._occluders
            self._run(
                surface.nearest, depth, ids, occluders.depth, occluders.covered, self._surfaces.ids
            )
        self._frame.clock.lap("median")
        return {
            "depth": depth,
            "primId": ids[0],
            "instanceId": ids[1],
            "elementId": ids[2],
            "row": ids[3],
        }

    def _places(
        self, median: dict[str, Any], motion: Motion | None, y0: int, wanted: set[str]
    ) -> dict[str, Any]:
        """Return positions and motion of the splat or surface at the median depth."""
        arrays: dict[str, Any] = {}
        depth, screen = median["depth"], self._sample.screen
        x0 = screen.window[0]
        if "P" in wanted:
            arrays["P"] = self._buffers.positions(*depth.shape)
            to_world = np.ascontiguousarray(np.linalg.inv(screen.world_to_camera)[:3])
            self._run(
                position.positions, screen.view_record(), to_world, depth, x0, y0, arrays["P"]
            )
        if motion is not None:
            arrays |= motion.draw(
                self._frame.device, self._buffers, median, self._surfaces, (x0, y0), wanted
            )
        self._frame.clock.lap("places")
        return arrays

    def _number_elements(self, median: dict[str, Any]) -> None:
        """Convert rows of nodes of splat trees to element ids of the trees."""
        assert isinstance(self._sample.splats, ProjectedSplats)
        first = self._sample.splats.layout.first_elements
        if first.size:
            keep = self._frame.device.keep
            self._run(
                median_kernels.number_elements, median["row"], keep(first), median["elementId"]
            )

    def _features(self, left: F32 | None, wanted: set[str]) -> dict[str, Any]:
        """Return sums of features over all contributions to a pixel."""
        arrays: dict[str, Any] = {}
        surfaces, nothing = self._surfaces, np.empty((0, 0), np.float32)
        if "albedo" in wanted:
            image = self._tiles.sums("albedo")
            behind = None if surfaces is None else surfaces.albedo
            arrays["albedo"] = composited(self._frame, image, left, behind, counts=False)
        for name, buffer in (("Neye", self._buffers.normals), ("Naxis", self._buffers.axes)):
            if name in wanted:
                sums = self._tiles.sums(PRODUCT[name])
                arrays[name] = buffer(*sums.shape[:2])
                none = np.empty((0, 0, 3), np.float32)
                self._run(
                    feature.unit, sums, none if surfaces is None else surfaces.normal,
                    none[..., 0] if left is None else left, arrays[name],
                )  # fmt: skip
        if not wanted & {"depthExpected", "confidence", "occlusion"}:
            self._frame.clock.lap("features")
            return arrays
        sums, shown = self._tiles.sums("depths"), nothing if left is None else left
        if "depthExpected" in wanted:
            arrays["depthExpected"] = self._buffers.expected_depth(*sums.shape[:2])
            self._run(
                feature.expected, sums, shown, nothing if surfaces is None else surfaces.depth,
                arrays["depthExpected"],
            )  # fmt: skip
        for name, channel, facts, of_surfaces in (
            ("confidence", feature.CONFIDENCE_SUM, self._buffers.confidence, 1),
            ("occlusion", feature.OCCLUSION_SUM, self._buffers.occlusion, 0),
        ):
            if name in wanted:
                arrays[name] = facts(*sums.shape[:2])
                of_surface = np.float32(of_surfaces)
                self._run(feature.mean, sums, channel, shown, of_surface, arrays[name])
        self._frame.clock.lap("features")
        return arrays

    def _matte(self, layer: str, groups: MatteGroups, left: F32 | None, *, raw: bool) -> Any:
        """Return the coverage of each pixel by each group of a layer of Cryptomatte."""
        found, weights = self._tiles.weigh(layer)
        shown, part = np.empty((0, 0), np.int32), np.empty((0, 0), np.float32)
        if left is not None and self._surfaces is not None:
            shown, part = self._shown(layer, groups, left), left
        if raw:
            pairs = [(found, weights)]
            if shown.size:
                pairs.append((shown.reshape((*shown.shape, 1)), part.reshape((*part.shape, 1))))
            return pairs
        # averaging a single sample would read and write all slots of each pixel three times
        pairs_of = rank_pairs(self._frame.settings.crypto_rank)
        ranked = self._frame.buffers.matte(layer).ranked(*self._tiles.shape, pairs_of)
        hashes = self._frame.device.keep(groups.hashes)
        self._run(cryptomatte.rank, found, weights, shown, part, hashes, ranked)
        self._frame.clock.lap("mattes")
        return ranked

    def _shown(self, layer: str, groups: MatteGroups, left: F32) -> I32:
        """Return the group of the visible surface of each pixel, -1 without one, shape (h, w)."""
        band, surfaces, keep = self._surfaces, self._sample.surfaces, self._frame.device.keep
        assert band is not None and surfaces is not None
        out: I32 = self._frame.buffers.matte(layer).surfaces(*left.shape)
        if groups.of_materials is None:
            self._run(surface.shown, left, band.ids, keep(groups.of_prims), out)
        else:
            self._run(
                surface.shown_material, left, band.hit, surfaces.shapes[0], surfaces.material_of,
                keep(groups.of_materials), out,
            )  # fmt: skip
        return out


def composited_parts(
    frame: FrameContext,
    parts: tuple[str, ...],
    layers: F32,
    left: F32 | None,
    behind: SurfaceBand | None,
) -> dict[str, Any]:
    """Return the AOVs of light groups, composited over surfaces; before `composited` colour, which
    changes the colours of the surfaces.

    Args:
        layers: See `SplatLayers.lights`; it is changed.
        left: Transmittance of the splats to the surfaces, shape (h, w); None without surfaces.
        behind: The surfaces; None without any.
    """
    found, height = {}, layers.shape[0] // len(parts)
    for k, name in enumerate(parts):
        layer = layers[k * height : (k + 1) * height]
        color = None if behind is None else _part_of(frame, behind, name)
        found[name] = composited(frame, layer, left, color, counts=False)
    return found


def _part_of(frame: FrameContext, band: SurfaceBand, name: str) -> F32:
    """Return the colours that one light group gives surfaces, linear Rec.709, shape (h, w, 3)."""
    run, light = frame.device.run, band.light
    out: F32 = frame.buffers.lit.colors(*band.color.shape[:2])
    if light is None:
        run(total.clear, out)
        if name == CAPTURED:
            run(total.add, out, band.color)
        return out
    part = np.empty((0, 3), np.float32) if name == CAPTURED else light.parts[name]
    ambient = np.float32(light.ambient)
    run(light_parts.surface_part, band.color, light.sums, part, light.first, ambient, out)
    return out


def composited(
    frame: FrameContext,
    splats: F32,
    left: F32 | None,
    behind: F32 | None,
    *,
    counts: bool = True,
) -> F32:
    """Return a splat layer in the picture's space, composited over surfaces.

    Args:
        splats: Premultiplied RGBA in the blend space, shape (h, w, 4). It may be changed.
        left: Transmittance to the surfaces, shape (h, w); None without surfaces.
        behind: Colours of the surfaces, linear Rec.709, shape (h, w, 3); None without surfaces.
        counts: Whether pixels count in `Output.failed` and `Output.covered`.
    """
    image = frame.output.splats(splats, counts=counts)
    if left is not None and behind is not None:
        frame.device.run(surface.over, image, left, frame.output.surfaces(behind))
    frame.clock.lap("output")
    return image
