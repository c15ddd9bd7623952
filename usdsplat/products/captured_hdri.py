"""Light of photographs that a picture on the command line holds, while a stage is relit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom, UsdLux

from usdsplat import schema
from usdsplat.core.errors import FormatError, UsageError
from usdsplat.core.findings import Finding
from usdsplat.delegate.scene_delegate.unsupported import LIGHTS
from usdsplat.images.texture import read_texture
from usdsplat.interchange.placement import from_capture

PHOTOGRAPHED = "SplatCapturedLight"
"""Name of the dome with the HDRI of the set below a field, on a layer that is not saved."""


@contextmanager
def photographed_in(stage: Usd.Stage, picture: Path | None) -> Iterator[None]:
    """Name hidden domes with a picture as the light of all photographs, while the stage is relit.

    Each field has its own dome, which is below it: the set turns with the capture. Its top is up in
    the space that an import turns the axes of a capture into.

    Raises:
        UsageError: If no field needs the picture, and it cannot be read.
    """
    if picture is None:
        yield
        return
    layer = Sdf.Layer.CreateAnonymous("captured.usda")
    session = stage.GetSessionLayer()
    session.subLayerPaths.insert(0, layer.identifier)
    try:
        with Usd.EditContext(stage, layer):
            fields = [
                prim for prim in stage.Traverse()
                if schema.is_splat_field(prim) and not _names_light(prim)
            ]  # fmt: skip
            if not fields:
                check_picture(picture)
            for prim in fields:
                path = prim.GetPath().AppendChild(PHOTOGRAPHED)
                dome = UsdLux.DomeLight_1.Define(stage, path)
                dome.CreateTextureFileAttr(str(picture.resolve()))
                dome.MakeInvisible()
                upright = from_capture(prim).GetInverse()
                UsdGeom.Xformable(dome).AddTransformOp().Set(upright)
                names = prim.CreateRelationship(schema.tokens.CAPTURED_LIGHTS, custom=False)
                names.SetTargets([path])
        yield
    finally:
        session.subLayerPaths.remove(layer.identifier)


def check_picture(picture: Path) -> None:
    """Raise an error for a picture that cannot be read.

    Raises:
        UsageError: If it is not there, or no picture.
    """
    try:
        read_texture(picture)
    except FormatError as error:
        raise UsageError("--captured-hdri", str(picture), error.expected) from None


def of_picture(found: Finding) -> Finding:
    """Return a finding; one on a dome of the picture names the flag in place of the dome.

    Raises:
        UsageError: If the picture cannot be read.
    """
    above, _, name = found.path.rpartition("/")
    if name != PHOTOGRAPHED:
        return found
    if not found.attribute.startswith("inputs:texture"):
        return replace(found, path=above, attribute="")
    if found.code == "bad-light":
        raise UsageError("--captured-hdri", found.found, found.expected)
    return replace(found, path="--captured-hdri", attribute="")


def _names_light(field: Usd.Prim) -> bool:
    """Return whether a field names a light of its photographs that is on the stage."""
    named = map(field.GetStage().GetPrimAtPath, schema.captured_lights(field))
    return any(each and each.IsA(kind) for each in named for kind in LIGHTS)
