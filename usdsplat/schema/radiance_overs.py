"""Write the colours of splats alone, as an over of a field."""

from __future__ import annotations

from pxr import Sdf, Usd

from usdsplat.core.cloud import SplatCloud
from usdsplat.schema import packed, packing, proxy, stock, tokens
from usdsplat.schema.attributes import set_uniform
from usdsplat.schema.field import form_of


def author_radiance(
    stage: Usd.Stage, field: Usd.Prim, cloud: SplatCloud, *, time: float | None = None
) -> None:
    """Write the harmonics of a field as an over at its path, in the field's own form.

    The proxy of a packed field gets their colours, too.

    Args:
        stage: Stage whose edit target receives the over; it may be empty otherwise.
        field: The field, on a stage of its own.
        cloud: The splats of the field with new harmonics of the same degree.
        time: Time code of a sample; None writes the default values.

    Raises:
        UsageError: If the field stores half precision and a number exceeds its range.
    """
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    over, form = stage.OverridePrim(field.GetPath()), form_of(field)
    if form != "packed":
        stock.author_harmonics(over, cloud, half=form == "half", code=code)
        return
    packed.author_appearance(over, packing.pack(cloud), code=code)
    for points in proxy.existing(field):
        proxy.author_colors(stage.OverridePrim(points.GetPath()), cloud, code=code)


def author_captured(stage: Usd.Stage, path: str) -> None:
    """Write an over of a field that says that its colours are not to be lit again.

    Args:
        stage: Stage whose edit target receives the over.
        path: Path of the field.
    """
    over = stage.OverridePrim(path)
    over.AddAppliedSchema(tokens.LIGHTING_API)
    set_uniform(over, tokens.LIGHTING, Sdf.ValueTypeNames.Token, "captured")
