"""Stages with cameras, and what is in a page."""

from __future__ import annotations

import base64
import json
import math
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from pxr import Gf, Usd, UsdGeom

from tests.delegate.stages import add_camera, random_cloud, two_fields
from usdsplat import schema

FRAMES = 12


def still_stage(up_axis: str = "Y") -> Usd.Stage:
    """Two clouds and a camera that looks down -z."""
    stage = two_fields()
    UsdGeom.SetStageUpAxis(stage, up_axis)
    add_camera(stage, eye=(1.0, 2.0, 10.0))
    return stage


def moving_stage() -> Usd.Stage:
    """A cloud and a camera that goes a third around it, rolls and zooms, frames 1 to 12."""
    stage = Usd.Stage.CreateInMemory()
    cloud = random_cloud(4, n=300, degree=2)
    schema.author(stage, "/World/A", replace(cloud, scales=0.4 * cloud.scales, sh=0.4 * cloud.sh))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(FRAMES)
    stage.SetTimeCodesPerSecond(24)
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    move = camera.AddTransformOp()
    middle = Gf.Vec3d(0, 0, 0)
    for frame in range(1, FRAMES + 1):
        angle = 2 * math.pi / 3 * (frame - 1) / (FRAMES - 1)
        eye = middle + Gf.Vec3d(8 * math.sin(angle), 0.2 * frame, 8 * math.cos(angle))
        up = Gf.Vec3d(0.03 * frame, 1, 0)
        move.Set(Gf.Matrix4d().SetLookAt(eye, middle, up).GetInverse(), frame)
        camera.GetFocalLengthAttr().Set(30.0 + frame, frame)
    return stage


def turntable_stage() -> Usd.Stage:
    """Two clouds and a camera that goes around them in 24 frames."""
    stage = two_fields()
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(23)
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    turn = camera.AddRotateYOp()
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 9))
    for frame in range(24):
        turn.Set(15.0 * frame, frame)
    return stage


@dataclass(eq=False)
class Parsed(HTMLParser):
    """The elements of a page, as a parser other than ours sees them."""

    text: str
    tags: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    scripts: list[tuple[dict[str, str | None], str]] = field(default_factory=list)
    title: str = ""

    def __post_init__(self) -> None:
        super().__init__()
        self._open = ""
        self.feed(self.text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._open = tag
        if tag == "script":
            self.scripts.append((dict(attrs), ""))

    def handle_endtag(self, tag: str) -> None:
        self._open = ""

    def handle_data(self, data: str) -> None:
        if self._open == "script":
            attributes, before = self.scripts[-1]
            self.scripts[-1] = attributes, before + data
        if self._open == "title":
            self.title += data

    @property
    def data(self) -> dict[str, Any]:
        """What our script reads."""
        (found,) = (text for attributes, text in self.scripts if attributes.get("id") == "page")
        return dict(json.loads(found))

    @property
    def capture(self) -> bytes:
        """The capture in the page."""
        parts = [text for attributes, text in self.scripts if attributes.get("class") == "capture"]
        return b"".join(map(base64.b64decode, parts))


def parsed(path: Path) -> Parsed:
    """Parse a page."""
    return Parsed(path.read_text(encoding="utf-8"))
