"""Codes of simulations, of the arrays of splat fields, of other files and of libraries."""

from __future__ import annotations

from usdsplat.core.finding_codes.code import Code

_REWRITE = "author it again, for example with usdsplat convert"

CODES: dict[str, Code] = {
    # --- simulations ---
    "unused": Code(
        "warning",
        "an authored property has no effect",
        "correct the property, or remove it",
    ),
    "not-masked": Code(
        "warning",
        "a mask is bound to a parameter that cannot take one",
        "bind it to a parameter that `usdsplat simulate --list-parameters` marks with M",
        "the parameter is the same for all splats",
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
    "not-relit": Code(
        "warning",
        "the colours of a field cannot be authored under other lights",
        "show the field, edit it outside its instances, or relight the captures of a splat tree",
    ),
    "no-normals": Code(
        "warning",
        "normals cannot be authored on a field",
        "edit the field outside its instance, or make normals of the captures of a splat tree",
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
    "large-splats": Code(
        "note",
        "splats stay larger than splatSim:refine:maxSize, because there are enough already",
        "increase splatSim:refine:budget or splatSim:refine:maxSize",
    ),
    "no-carriers": Code(
        "warning",
        "a capture has too few splats on surfaces for matter or transport",
        "simulate a capture of surfaces, or leave out matter and conform:mode transport",
    ),
    "no-room": Code(
        "warning",
        "splatSim:sim:maxCount has no room for all new matter; a note where some grows",
        "increase splatSim:sim:maxCount, or decrease splatSim:refine:budget",
    ),
    "flat-target": Code(
        "warning",
        "a mesh that splats conform to has no area",
        "correct the mesh, or use conform:mode closest",
    ),
    "weak-matter": Code(
        "warning",
        "matter tears before it reaches its stretch limit",
        "increase splatSim:matter:tear, or decrease splatSim:matter:stretch",
    ),
    "long-steps": Code(
        "warning",
        "steps of a simulation are too long to follow swings and fast affectors",
        "increase splatSim:sim:substeps or the stage's timeCodesPerSecond",
    ),
    "vast-affector": Code(
        "warning",
        "an affector is far larger than the capture",
        "correct its size, or the units of its asset",
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
    "bad-meters-per-unit": Code(
        "error",
        "the stage's metersPerUnit is not a positive number",
        "author the length of a unit in metres",
    ),
    "no-meters-per-unit": Code(
        "warning", "the stage has no metersPerUnit", "author metersPerUnit in the root layer"
    ),
    # --- splat trees ---
    "broken-tree": Code(
        "error",
        "the table of a splat tree is not that of a tree",
        "build the tree again",
        "the tree is not drawn",
    ),
    "missing-chunk": Code(
        "error",
        "layers with the splats of a tree are missing",
        "move the folder of the chunks back beside the stage of the tree, or build it again",
        "coarser nodes are drawn in their place, or nothing",
    ),
    "broken-chunk": Code(
        "error",
        "a layer with the splats of a tree cannot be read, or does not fit its table",
        "restore the layer, or build the tree again; if it replaces the splats on purpose, clear "
        "splat:chunkDigests",
        "coarser nodes are drawn in its place, or nothing",
    ),
    "edited-chunk": Code(
        "warning",
        "the splats in a layer of a tree are not those with which the tree was built",
        "build the tree again, so that its coarser levels show the change",
        "coarser levels do not show the change",
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
        "a field that is written to a capture or a page has a grade, a crop or a light of its own, "
        "or the picture that a page shows has shadows or is relit",
        "apply the crop with --crop-box or --crop-sphere, grade in another application, and "
        "relight with usdsplat relight; or convert to a stage, which keeps all",
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
