"""The codes of findings: severity, meaning and cure of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]

LIBRARY_MESSAGES = ("usd-message", "python-warning")
"""Codes of messages of libraries, which commands print with --verbose only."""


@dataclass(frozen=True, slots=True)
class Code:
    """Meaning of a code."""

    severity: Severity
    """Usual severity."""
    meaning: str
    """What was found, as one sentence without a full stop."""
    cure: str
    """Usual cure, unless a finding has a better one."""
    consequence: str = ""
    """What happens instead, added to each sentence; "" if the sentence says it."""


_REWRITE = "author it again, for example with usdsplat convert"

CODES: dict[str, Code] = {
    # --- composition ---
    "missing-asset": Code(
        "error",
        "a reference, payload, sublayer or texture names a file that is missing or unreadable",
        "restore the file, or correct the asset path",
    ),
    "missing-prim": Code(
        "error",
        "a reference or a collection names a prim that does not exist",
        "correct the path",
    ),
    "composition": Code(
        "warning",
        "USD cannot compose a part of the stage as authored",
        "correct the composition arc that the sentence names",
    ),
    "units-mismatch": Code(
        "warning",
        "an asset has another metersPerUnit than the layer that refers to it",
        "scale the prim that refers to it, or convert the asset",
        "the asset is not scaled",
    ),
    "axes-mismatch": Code(
        "warning",
        "an asset has another upAxis than the layer that refers to it",
        "rotate the prim that refers to it, or convert the asset",
        "the asset is not turned",
    ),
    "ignored-opinion": Code(
        "warning",
        "an opinion below an instanceable prim has no effect",
        "author it in the instanced asset, or set instanceable to false on the prim",
    ),
    # --- drawing ---
    "not-drawn": Code(
        "error",
        "a splat field or a surface cannot be drawn",
        "correct the values that the sentence names",
        "it is not drawn",
    ),
    "left-out": Code(
        "warning",
        "a part of a surface, such as a primvar or a subset, cannot be used",
        "correct the values that the sentence names",
        "it is left out",
    ),
    "bad-instancer": Code(
        "error",
        "a point instancer, or one of its prototypes, cannot be used",
        "correct the values that the sentence names",
    ),
    "bad-transform": Code(
        "error",
        "a transform is not finite, or has an op that USD does not know",
        "correct the xformOps of the prim or its ancestors",
        "what it places is not drawn",
    ),
    "bad-camera": Code(
        "error",
        "a camera cannot form an image",
        "correct the attribute that the sentence names",
    ),
    "bad-shutter": Code(
        "warning",
        "a shutter closes before it opens",
        "set shutter:open to no more than shutter:close",
    ),
    "bad-light": Code(
        "error",
        "the numbers or the transform of a light are not usable",
        "correct the attribute that the sentence names",
    ),
    "crop-member": Code(
        "error",
        "a member of a crop collection cannot crop",
        "remove it from the collection, or replace it with a shape",
        "it does not crop",
    ),
    "empty-crop": Code(
        "error",
        "a crop collection has no volumes, or a volume has no size",
        "add a shape with a size, or remove the collection",
    ),
    "unsupported-light": Code(
        "warning",
        "a light is of a type that is not supported; only DistantLight is",
        "use distant lights, or hide the light",
        "it does not light the surfaces",
    ),
    "unsupported-input": Code(
        "warning",
        "an input of a light or a shader is not supported",
        "remove it, or bake its effect into diffuseColor",
        "it has no effect",
    ),
    "unsupported-surface": Code(
        "warning",
        "a material has no UsdPreviewSurface",
        "add a UsdPreviewSurface for all renderers to the material",
        "displayColor or grey is drawn",
    ),
    "unsupported-prim": Code(
        "warning",
        "a prim is of a type that is not drawn, such as curves or a volume",
        "convert it to a mesh, or hide it",
        "it is not drawn",
    ),
    "unknown-type": Code(
        "error",
        "USD has loaded no schema with the type of a prim",
        "correct the type, or load the plug-in with its schema",
        "it is not drawn",
    ),
    # --- products ---
    "unknown-var": Code(
        "warning",
        "a RenderVar requests something that is not rendered",
        "use one of the listed names as sourceName, or remove the var from the product",
        "it is left out",
    ),
    "unsupported-pass": Code(
        "warning",
        "a collection of a RenderPass is not supported",
        "set visibility on the stage instead",
        "all are drawn, because the collection is not supported",
    ),
    "deep-aovs": Code(
        "warning",
        "a deep picture holds only color, Z, ids and cryptoObject",
        "request the other AOVs with a flat product",
        "the others are left out",
    ),
    "deep-settings": Code(
        "note",
        "settings apply to flat pictures only",
        "use them for a flat product",
        "they have no effect on a deep picture",
    ),
    "unsupported-name": Code(
        "note",
        "a RenderVar names channels otherwise than usdsplat does",
        "rename the channels in compositing, or author sourceName",
        "the channels have the names of the AOV",
    ),
    "png-aovs": Code(
        "warning",
        "a PNG holds only color",
        "name an EXR for the other AOVs",
        "the others are left out",
    ),
    "unused-config": Code(
        "note",
        "the variable OCIO names a config, but a picture for displays has no OCIO view",
        "give --view or --bake-view, or author splat:ocioView",
        "the picture has plain sRGB",
    ),
    "unused-view": Code(
        "note",
        "an OCIO view or config is named for a picture that is not drawn through a view",
        "give --bake-view, or --color-mode inverseView",
        "it has no effect",
    ),
    "product-metadata": Code(
        "warning",
        "a RenderProduct asks for a header entry or a compression that pictures cannot have",
        "choose another name, or remove the attribute",
        "it is left out",
    ),
    "bad-window": Code(
        "error",
        "a data window is not finite",
        "author finite numbers",
        "the whole window is rendered",
    ),
    "bad-product": Code(
        "error",
        "a RenderProduct cannot be drawn as authored",
        "correct the attribute that the sentence names",
    ),
    "bad-settings": Code(
        "error",
        "a RenderSettings prim or a RenderPass cannot be used",
        "correct the attribute that the sentence names",
    ),
    "wide-lens": Code(
        "warning",
        "a lens is wider than a tenth of its focus distance, so that nearly all is blurred",
        "check focalLength, fStop and focusDistance: USD's focal lengths are in tenths of a scene "
        "unit, so that millimetres need a metersPerUnit of 0.01",
    ),
    "holdout-depth": Code(
        "warning",
        "a flat holdout has pixels with A above 0 but no finite depth, as pictures have whose A is "
        "filtered or averaged over samples and whose Z is not",
        "use a holdout with the depth of the nearest surface wherever A is above 0, or a deep one",
        "these pixels hide nothing",
    ),
    "nothing-checked": Code(
        "warning",
        "a stage has nothing to check",
        "check the path of the file, its payloads and its population mask",
    ),
    "not-checked": Code(
        "note",
        "a stage has more times with samples than are checked",
        "check single frames with --frame",
    ),
    "unreadable": Code(
        "error",
        "a file to check cannot be read",
        "repair the file, or correct its path",
    ),
    "no-blur": Code(
        "note",
        "a camera has a shutter or a lens, but one sample shows no blur",
        "render with several samples, for example --samples 64",
    ),
    "outside-range": Code(
        "note",
        "a frame to draw is outside of the range from the stage's startTimeCode to its endTimeCode",
        "check --frames, or the range of the stage",
        "it is drawn with the values that the stage has there",
    ),
    "nothing-to-draw": Code(
        "error",
        "nothing is drawn in a picture",
        "check visibility, purposes, camera and clipping range",
        "the picture is empty",
    ),
    # --- names ---
    "unknown-name": Code(
        "warning",
        "a property in the namespace splat: or splatSim:, or an input of a shader, has an unknown "
        "name",
        "correct the name, or remove the property",
    ),
    # --- simulations ---
    "unused": Code(
        "warning",
        "an authored property has no effect",
        "correct the property, or remove it",
    ),
    "not-simulated": Code(
        "error",
        "a simulation cannot run",
        "correct the value that the sentence names",
    ),
    "no-results": Code(
        "error",
        "the data of a bake is missing",
        "restore the folder of its data, or bake it again",
    ),
    "unfinished-bake": Code(
        "error",
        "a bake was interrupted, and lacks frames",
        "continue it with simulate --resume and the same --set, or bake it again with --force",
    ),
    "left-out-of-simulation": Code(
        "warning",
        "a field or its ids are not simulated as authored",
        "edit the field outside its instance, or correct its ids",
    ),
    "fine-pattern": Code(
        "warning",
        "a reaction-diffusion pattern is finer than the splats can show",
        "increase splatSim:rd:patternScale, or use more splats",
    ),
    "trapped-splats": Code(
        "warning",
        "splats remain inside affectors",
        "leave enough space between affectors",
    ),
    # --- arrays of fields ---
    "wrong-type": Code("error", "an attribute does not have the schema's type", _REWRITE),
    "empty-first": Code(
        "warning",
        "the first time sample of an array is empty",
        "begin with at least one splat; its opacity can be 0",
    ),
    "no-splats": Code("warning", "a field has no splats", "author positions"),
    "missing": Code("warning", "an attribute of a field has no value", "author it"),
    "too-short": Code(
        "error", "an array has fewer values than splats", "author one value for each centre"
    ),
    "too-long": Code(
        "warning", "an array has more values than splats", "author one value for each centre"
    ),
    "not-finite": Code(
        "error", "an array has NaN or infinity", "prune the splats with NaN or infinity"
    ),
    "repeated-ids": Code(
        "error", "several splats have the same id", "give every splat a unique id"
    ),
    "half-only": Code(
        "warning",
        "only half arrays are authored, which other applications do not read",
        "convert to the float form for interchange",
    ),
    "negative-scale": Code("error", "a scale is negative", "author standard deviations"),
    "zero-scale": Code(
        "warning",
        "a scale is 0, which other applications reject",
        "give flat splats a small thickness",
    ),
    "not-unit": Code("error", "an orientation is no unit quaternion", "normalise the quaternions"),
    "opacity-range": Code("error", "an opacity is outside 0 to 1", "author opacities"),
    "degree": Code(
        "error", "the degree of the harmonics is invalid", "author the degree of the coefficients"
    ),
    "interchange-degree": Code(
        "warning",
        "the degree is higher than other applications read",
        "lower the degree for interchange",
    ),
    "coefficient-count": Code(
        "error",
        "the number of harmonics does not fit splats and degree",
        "author (degree + 1)^2 for each centre",
    ),
    "element-size": Code(
        "warning", "the elementSize of the harmonics is wrong", "set the attribute's elementSize"
    ),
    "interpolation": Code(
        "warning",
        "the interpolation of the harmonics is wrong",
        "set the attribute's interpolation",
    ),
    "no-color-space": Code(
        "warning", "a field has no colour space", "apply ColorSpaceAPI and name one"
    ),
    "unknown-color-space": Code(
        "error", "USD does not know the colour space of a field", "name one of Gf.ColorSpaceNames"
    ),
    "unknown-mode": Code("error", "a rendering hint has an unknown value", "author a listed one"),
    "illegal-grade": Code("error", "a grade is out of range", "author a legal value"),
    "no-extent": Code("error", "a field has no extent", "author the extent"),
    "extent-size": Code("error", "an extent has not two corners", "author the extent"),
    "extent-too-small": Code("warning", "an extent does not hold the splats", "author the extent"),
    "unknown-packing": Code(
        "error",
        "the layout of a packed field is unknown",
        "read the prim with the version of usdsplat that wrote it, or a newer one",
    ),
    "packed-count": Code("error", "packed arrays do not fit together", _REWRITE),
    "range": Code("error", "the value range of a packed field is invalid", _REWRITE),
    "bad-up-axis": Code("error", "the stage's upAxis is neither Y nor Z", "author Y or Z"),
    "no-up-axis": Code("warning", "the stage has no upAxis", "author upAxis in the root layer"),
    "no-meters-per-unit": Code(
        "warning", "the stage has no metersPerUnit", "author metersPerUnit in the root layer"
    ),
    # --- other files ---
    "not-converted": Code(
        "error",
        "a field cannot be converted within a file that refers to others",
        "convert with --flatten, or convert the file that has the field",
        "it keeps its form",
    ),
    "not-applied": Code(
        "warning",
        "a field that is written to a capture has a grade or a crop",
        "apply the crop with --crop-box or --crop-sphere, and grade in another application; or "
        "convert to a stage, which keeps both",
        "it is not applied",
    ),
    "assumed-space": Code(
        "note",
        "a reference picture does not name its colour space",
        "give --reference-space, or write the space into the file",
    ),
    # --- libraries ---
    "usd-message": Code(
        "note",
        "a message of USD itself, printed with --verbose",
        "see the documentation of USD",
    ),
    "python-warning": Code(
        "note",
        "a warning of NumPy or another library, printed with --verbose",
        "report it with the file if the result is wrong",
    ),
}
"""Code -> its meaning. Codes of validation are also names of UsdValidation errors, in camelCase."""
