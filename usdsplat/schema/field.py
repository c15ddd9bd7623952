"""Read and write splat fields on a stage; other packages use this interface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

from pxr import Sdf, Usd, UsdVol, Vt

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError, UsageError, UsdSplatError
from usdsplat.schema import attributes, hints, packed, packing, proxy, registration, stock, tokens
from usdsplat.schema.attributes import Time, set_array
from usdsplat.schema.defining import author_color_space, author_fallback_type, define
from usdsplat.schema.extent import compute_extent
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.tokens import Form
from usdsplat.schema.vt import to_vt

_Type = Sdf.ValueTypeNames
NO_HINTS = DrawingHints()


def author(
    stage: Usd.Stage,
    path: str | Sdf.Path,
    cloud: SplatCloud,
    *,
    form: Form = "float",
    time: float | Usd.TimeCode | None = None,
    color_space: str | None = None,
    drawing: DrawingHints = NO_HINTS,
) -> Usd.Prim:
    """Write a cloud as a splat field on the stage's edit target.

    An existing prim is retyped by an `over`, so a result layer leaves the original untouched; its
    arrays of another form are removed. Further calls with other times add samples.

    Args:
        stage: The stage; its edit target is written.
        path: Absolute path of the prim.
        cloud: The splats.
        form: "float" and "half" are the stock type; "packed" is our own, a third of the size.
        time: Time code of a sample; None writes default values and removes samples.
        color_space: Colour space the harmonics were trained in; None keeps the authored or
            inherited one, or writes srgb_rec709_scene if there is none.
        drawing: Rendering hints of the field; None keeps the authored ones.

    Returns:
        The prim.

    Raises:
        UsageError: If an option has an invalid value, or a number exceeds the range of the form.
        StageError: If the prim cannot be written, or its other samples have another degree.
        SchemaUnavailableError: If the form is "packed" and USD does not know the type.
    """
    _check_options(form, color_space)
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    _check_degree(stage, Sdf.Path(path), cloud, code)
    if form == "packed":
        prim = _author_packed(stage, path, cloud, code)
    else:
        prim = _author_stock(stage, path, cloud, form == "half", code)
    _author_identity(prim, cloud, code)
    author_color_space(prim, color_space)
    drawing.author(prim)
    return prim


def fetch(prim: Usd.Prim, time: Time = None) -> SplatCloud:
    """Read a splat field of any form, instance proxies included.

    Between samples, values of every form are interpolated if the samples have equal counts and
    equal ids, else held. Velocities extrapolate centres from the sample before, as
    `attributes.centres` describes, also after the last sample.

    Args:
        prim: A prim for which `is_splat_field` is true.
        time: Time code; None is the default value or, without one, the first sample.

    Returns:
        The cloud in the prim's local space; its arrays may be read-only views of USD's memory.

    Raises:
        StageError: If the prim is no splat field, its packed arrays cannot be decoded, or its
            attributes have types other than the schema's.
        SchemaUnavailableError: If the prim is packed and USD does not know the type.
    """
    if not is_splat_field(prim):
        where = str(prim.GetPath()) if prim else "prim"
        raise StageError(where, f"a prim of type {prim.GetTypeName()!s}", _EXPECTED)
    if is_packed(prim):
        registration.require(str(prim.GetPath()))
    read = packed.fetch if is_packed(prim) else stock.fetch
    try:
        return read(prim, attributes.time_code(prim, time), time)
    except UsdSplatError:
        raise
    except (TypeError, ValueError, OverflowError) as error:
        found = f"attributes of other types than the schema's ({error})"
        raise StageError(str(prim.GetPath()), found, "those of the schema") from error


def fetch_packed(prim: Usd.Prim, time: float | None) -> packing.PackedArrays | None:
    """Read a packed prim without decoding it; None between samples that are interpolated.

    Args:
        prim: A prim for which `is_packed` is true, and that `fetch` can read.
        time: As for `fetch`.
    """
    code = attributes.time_code(prim, time)
    positions, _ = attributes.centres(prim, tokens.POSITIONS, code, time)
    return packed.fetch_arrays(prim, code, len(positions))


def is_splat_field(prim: Usd.Prim) -> bool:
    """Return whether `fetch` reads this prim: stock (derived or by fallback too), draft, or
    packed."""
    if not prim:
        return False
    named = prim.GetTypeName() in (tokens.PACKED_TYPE, tokens.PRERELEASE_TYPE)
    return named or prim.IsA(UsdVol.ParticleField3DGaussianSplat)


def is_packed(prim: Usd.Prim) -> bool:
    """Return whether the prim is of our packed type, registered with USD or not."""
    return bool(prim.GetTypeName() == tokens.PACKED_TYPE)


def form_of(prim: Usd.Prim) -> Form:
    """Return the storage form of a splat field."""
    if is_packed(prim):
        return "packed"
    name = stock.source_name(prim, tokens.SH_COEFFICIENTS)
    return "half" if name == tokens.SH_COEFFICIENTS_HALF else "float"


def is_time_varying(prim: Usd.Prim) -> bool:
    """Return whether `fetch` may return different clouds at different times, or `fetch_surface`
    different normals."""
    names = tokens.DATA_ATTRIBUTES | tokens.SURFACE_ATTRIBUTES
    found = (prim.GetAttribute(name) for name in names)
    varies = any(attribute and attribute.ValueMightBeTimeVarying() for attribute in found)
    # Even one sample moves splats at all later times.
    return varies or attributes.have_velocities(prim)


def sample_times(prim: Usd.Prim) -> list[float]:
    """Return the sample times of a field, ascending; empty if it does not change."""
    return attributes.sample_times(prim, tokens.DATA_ATTRIBUTES)


def error_bounds(form: Form) -> Mapping[str, str]:
    """Return the error that a storage form adds, by field of the cloud; others are exact."""
    return {"float": {}, "half": stock.HALF_BOUNDS, "packed": packing.BOUNDS}[form]


_EXPECTED = f"{tokens.STOCK_TYPE} or {tokens.PACKED_TYPE}"


def _author_stock(
    stage: Usd.Stage, path: str | Sdf.Path, cloud: SplatCloud, half: bool, code: Usd.TimeCode
) -> Usd.Prim:
    """Write arrays and extent in a stock form."""
    if half:
        stock.check_half(cloud)
    prim = define(stage, path, tokens.STOCK_TYPE)
    stock.author(prim, cloud, half=half, code=code)
    proxy.remove(prim)
    prim.AddAppliedSchema(tokens.FIELD_API)
    _author_extent(prim, cloud, stock.HALF_SLACK if half else 0.0, code)
    return prim


def _author_packed(
    stage: Usd.Stage, path: str | Sdf.Path, cloud: SplatCloud, code: Usd.TimeCode
) -> Usd.Prim:
    """Write arrays, extent and proxy in the packed form."""
    registration.require(str(path))
    arrays = packing.pack(cloud)
    prim = define(stage, path, tokens.PACKED_TYPE)
    packed.author(prim, cloud.positions, arrays, code=code)
    _author_proxy(prim, cloud, code)
    author_fallback_type(stage, tokens.PACKED_TYPE)
    _author_extent(prim, cloud, packed.SLACK, code)
    return prim


def _author_proxy(prim: Usd.Prim, cloud: SplatCloud, code: Usd.TimeCode) -> None:
    """Write the proxy beside a packed field, in place of one that 0.6 wrote below it."""
    if child := proxy.child_of(prim):
        proxy.remove(prim)
        child = proxy.child_of(prim)
        if child:  # of a weaker layer
            child.SetActive(False)
    path = proxy.path_of(prim)
    if path is None:
        return
    is_first = code.IsDefault() or not prim.GetStage().GetPrimAtPath(path)
    points = proxy.author(prim, path, cloud, code=code)
    if is_first:
        proxy.place(prim, points)


def _author_extent(prim: Usd.Prim, cloud: SplatCloud, slack: float, code: Usd.TimeCode) -> None:
    """Write the extent, wide enough for the values that the form decodes to."""
    box = to_vt(compute_extent(cloud, slack=slack), Vt.Vec3fArray)
    set_array(prim, tokens.EXTENT, _Type.Float3Array, box, code)


def _check_options(form: Form, color_space: str | None) -> None:
    """Raise an error for invalid options before anything is written."""
    if form not in get_args(Form):
        raise UsageError("form", repr(form), f"one of {', '.join(get_args(Form))}")
    if color_space is not None and not hints.is_known_color_space(color_space):
        raise UsageError(
            "color_space", repr(color_space), f"a Gf name such as {tokens.DEFAULT_COLOR_SPACE}"
        )


def _check_degree(stage: Usd.Stage, path: Sdf.Path, cloud: SplatCloud, code: Usd.TimeCode) -> None:
    """Raise an error if a sample has another degree than the layer's others: it is uniform."""
    target = stage.GetEditTarget()
    layer, spec_path = target.GetLayer(), target.MapToSpecPath(path)
    written = layer.GetAttributeAtPath(spec_path.AppendProperty(tokens.SH_DEGREE))
    samples = layer.GetNumTimeSamplesForPath(spec_path.AppendProperty(tokens.POSITIONS))
    if code.IsDefault() or not samples or not written or written.default == cloud.sh_degree:
        return
    found = f"harmonics of degree {cloud.sh_degree}"
    raise StageError(f"{path} at {code.GetValue():g}", found, f"{written.default}, as before")


def _author_identity(prim: Usd.Prim, cloud: SplatCloud, code: Usd.TimeCode) -> None:
    """Write ids and velocities, or remove those of an earlier cloud."""
    for name, kind, vt_kind, value in (
        (tokens.IDS, _Type.Int64Array, Vt.Int64Array, cloud.ids),
        (tokens.VELOCITIES, _Type.Vector3fArray, Vt.Vec3fArray, cloud.velocities),
    ):
        if value is not None:
            set_array(prim, name, kind, to_vt(value, vt_kind), code)
        elif code.IsDefault():
            attributes.silence(prim, (name,))
        elif prim.GetAttribute(name).HasAuthoredValue():
            set_array(prim, name, kind, vt_kind(), code)
