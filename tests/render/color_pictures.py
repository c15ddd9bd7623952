"""Colour-only pictures that a GPU draws without the host: checks for tests on any GPU."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.render.everything import CASES, Case, drawn, scene_of, view_on
from tests.render.rendering import settings_of
from usdsplat.kernels.cuda.frame.pool import NodePool
from usdsplat.kernels.device import Device
from usdsplat.render.cuda import ColorPicture
from usdsplat.render.renderer import Renderer
from usdsplat.render.specs import PackedSpec
from usdsplat.schema import packing

FUSED = (
    "splats alone", "distance", "tangential", "budget", "linear", "inverse view", "samples",
    "tree in colour", "tree and samples",
)  # fmt: skip
OTHERWISE = ("crops", "rays", "matte splats", "points")
"""Cases that take the general path even where colour is all."""


def bare(name: str) -> Case:
    """A case with splats and colour alone."""
    return replace(CASES[name], surfaces=False, aovs=("color",))


def count_fused(monkeypatch: Any) -> list[ColorPicture]:
    """What draws fused pictures from now on, once for each."""
    made: list[ColorPicture] = []
    draw = ColorPicture.draw

    def counted(self: ColorPicture, *args: Any) -> Any:
        made.append(self)
        return draw(self, *args)

    monkeypatch.setattr(ColorPicture, "draw", counted)
    return made


def check_fused(
    gpu: Device, cpu: Device, name: str, size: tuple[int, int], splats: int, close: float
) -> None:
    """The case is the same on both devices."""
    ours = drawn(gpu, bare(name), size=size, splats=splats)
    theirs = drawn(cpu, bare(name), size=size, splats=splats)
    np.testing.assert_allclose(ours["stats"][0], theirs["stats"][0], rtol=0.02)
    apart = abs(ours["color"].astype(np.float64) - theirs["color"]).max(axis=-1)
    assert (apart > close).mean() < 0.004
    assert (theirs["color"][..., 3] > 0.1).any()


def check_packed(gpu: Device, size: tuple[int, int], splats: int) -> None:
    """A field that is packed on its prim is the same as what it unpacks to."""
    case = bare("splats alone")
    pictures = []
    for is_packed in (False, True):
        scene = scene_of(case, splats)
        for path, field in tuple((path, field) for path, field, _ in scene.drawn()):
            cloud = field.spec.cloud
            arrays = packing.pack(cloud)
            width = max(1, packing.harmonics_width(arrays.degree))
            packed = PackedSpec(
                words=arrays.core,
                harmonics=arrays.harmonics.reshape(-1, 4 * width),
                color_range=arrays.color_range.ravel(),
                steps=arrays.harmonics_range / np.float32(127),
            )
            spec = replace(field.spec, cloud=packing.unpack(cloud.positions, arrays))
            scene.set_field(path, replace(spec, packed=packed if is_packed else None))
        renderer = Renderer(gpu)
        bands = renderer.render(scene, view_on(case, size), settings_of(), ("color",))
        pictures.append(np.concatenate([band.arrays["color"].copy() for band in bands]))
    np.testing.assert_allclose(*pictures, atol=1e-3)
    assert (pictures[0] != pictures[1]).any()  # they were not read from the same arrays


def check_only_new_nodes_are_sent(gpu: Device, cpu: Device, monkeypatch: Any, close: float) -> None:
    """Cuts of a tree that follow each other: each node goes to the device once, and each picture is
    that of the CPU."""
    sent: list[int] = []
    send = NodePool._send

    def noted(self: NodePool, clouds: Any, pages: Any) -> None:
        sent.extend(id(each) for each in clouds)
        send(self, clouds, pages)

    monkeypatch.setattr(NodePool, "_send", noted)
    case = bare("tree in colour")
    scene, view = scene_of(case, 8), view_on(case, (20, 18))
    renderers = Renderer(gpu), Renderer(cpu)
    known: set[int] = set()
    for error, count, is_new in ((1e3, 1, True), (1.0, 2, True), (1.0, 2, False), (0.0, 1, False)):
        settings = settings_of(lod_error=error, lod_samples=count)
        sent.clear()
        ours, theirs = (
            np.concatenate([band.arrays["color"].copy() for band in bands])
            for bands in (each.render(scene, view, settings, ("color",)) for each in renderers)
        )
        fields = [each for _, tree in scene.drawn_trees() for each in tree.fields.values()]
        drawn = {id(each.spec.cloud) for each in fields}
        assert sorted(sent) == sorted(drawn - known)
        assert bool(sent) == is_new
        known |= drawn
        assert (abs(ours.astype(np.float64) - theirs).max(axis=-1) > close).mean() < 0.004
        assert (theirs[..., 3] > 0.1).any()
    renderers[0].close()
