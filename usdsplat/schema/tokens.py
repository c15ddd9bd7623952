"""Names of splat types, properties and tokens on a stage.

Names without a prefix are the stock schema's (usdVol) or UsdGeomPoints'. Names under `splat:` are
ours and declared in schema.usda.
"""

from __future__ import annotations

from typing import Literal

Form = Literal["float", "half", "packed"]
"""Storage form of a field: stock float, stock half (float centres), or our packed type."""

STOCK_TYPE = "ParticleField3DGaussianSplat"
PRERELEASE_TYPE = "ParticleField_3DGaussianSplat"
"""Type name in drafts of the stock schema; files that use it are read."""
PACKED_TYPE = "ParticleFieldPackedSplat"
TREE_TYPE = "ParticleFieldSplatTree"
BASE_TYPE = "ParticleField"
FIELD_API = "SplatFieldAPI"
SETTINGS_API = "SplatRenderSettingsAPI"
GRADE_API = "SplatGradeAPI"
CROP_API = "SplatCropAPI"
CROP_INCLUDE = "cropInclude"
CROP_EXCLUDE = "cropExclude"
"""Collections of the volumes that crop a field."""

POSITIONS = "positions"
ORIENTATIONS = "orientations"
SCALES = "scales"
OPACITIES = "opacities"
SH_COEFFICIENTS = "radiance:sphericalHarmonicsCoefficients"
SH_DEGREE = "radiance:sphericalHarmonicsDegree"
EXTENT = "extent"
PROJECTION_MODE = "projectionModeHint"
SORTING_MODE = "sortingModeHint"
IDS = "ids"
VELOCITIES = "velocities"

POSITIONS_HALF = "positionsh"
ORIENTATIONS_HALF = "orientationsh"
SCALES_HALF = "scalesh"
OPACITIES_HALF = "opacitiesh"
SH_COEFFICIENTS_HALF = "radiance:sphericalHarmonicsCoefficientsh"

RASTERIZE_MODE = "splat:rasterizeMode"
FOOTPRINT = "splat:sampling:footprint"
PARENTS = "splat:parents"
PACKING = "splat:packing"
PACKED = "splat:packed"
PACKED_HARMONICS = "splat:packedHarmonics"
COLOR_RANGE = "splat:colorRange"
HARMONICS_RANGE = "splat:harmonicsRange"

NODE_LOW = "splat:nodeLow"
NODE_HIGH = "splat:nodeHigh"
NODE_ERRORS = "splat:nodeErrors"
NODE_FIRST_CHILD = "splat:nodeFirstChild"
NODE_CHILD_COUNT = "splat:nodeChildCount"
NODE_CHUNK = "splat:nodeChunk"
NODE_FIRST_ROW = "splat:nodeFirstRow"
NODE_PROXIES = "splat:nodeProxies"
NODE_RESIDENTS = "splat:nodeResidents"
CHUNKS = "splat:chunks"
CHUNK_DIGESTS = "splat:chunkDigests"
LOD_PIXEL = "splat:lod:pixel"
LOD_ROOT = "splat:lod:root"
"""Relationship of a splat tree to the LOD root that stands for it in other renderers."""

LIGHTING = "splat:lighting"
CAPTURED_LIGHTS = "splat:lighting:captured"
"""Relationship of a field to the lights in which it was photographed."""
LIGHTING_API = "SplatLightingAPI"
CATCHER_API = "SplatShadowCatcherAPI"

GRADE_EXPOSURE = "splat:grade:exposure"
GRADE_TEMPERATURE = "splat:grade:temperature"
GRADE_TINT = "splat:grade:tint"
GRADE_GAIN = "splat:grade:gain"
GRADE_SATURATION = "splat:grade:saturation"
GRADE_MATRIX = "splat:grade:matrix"

NORMALS = "normals"
CONFIDENCE = "splat:confidence"
OCCLUSION = "splat:occlusion"
"""Primvars of normals, how far to trust them, and the hidden part of the sky, without the prefix
of their attributes, `primvars:`."""

COLOR_SPACE = "colorSpace:name"
PURPOSE = "purpose"
PROXY_PRIM = "proxyPrim"
PROXY_CHILD = "proxy"
"""Name of the proxy Points prim below a packed field, in files of 0.6."""

SCHEMA_FALLBACK_DEGREE = 3
"""Degree of a prim without an authored degree."""

RASTERIZE_MODES = ("classic", "antialiased")
PROJECTION_MODES = ("perspective", "tangential")
LIGHTING_MODES = ("auto", "captured", "shadowed", "relit")
SORTING_MODES = ("zDepth", "cameraDistance", "rayHitDistance")

DEFAULT_COLOR_SPACE = "srgb_rec709_scene"
"""Colour space of a field without an authored one: most captures are trained in it."""
COLOR_SPACE_ALIASES = {"srgb_rec709_display": "srgb_rec709_scene"}
"""Names that other tools write and Gf does not know -> the equivalent name."""

HALF_OF = {
    POSITIONS: POSITIONS_HALF,
    ORIENTATIONS: ORIENTATIONS_HALF,
    SCALES: SCALES_HALF,
    OPACITIES: OPACITIES_HALF,
    SH_COEFFICIENTS: SH_COEFFICIENTS_HALF,
}
"""A stock float attribute -> its half twin."""

PACKED_ARRAYS = (PACKED, COLOR_RANGE, PACKED_HARMONICS, HARMONICS_RANGE)

DATA_ATTRIBUTES = frozenset(
    {*HALF_OF, *HALF_OF.values(), *PACKED_ARRAYS, PACKING, SH_DEGREE, IDS, VELOCITIES}
)
"""Attributes that determine the cloud returned by `fetch`."""

SHAPE_ATTRIBUTES = DATA_ATTRIBUTES - {
    SH_COEFFICIENTS, SH_COEFFICIENTS_HALF, SH_DEGREE, OPACITIES, OPACITIES_HALF, COLOR_RANGE,
    HARMONICS_RANGE, PACKED_HARMONICS, VELOCITIES,
}  # fmt: skip
"""Those that determine positions, rotations and scales."""
SURFACE_ATTRIBUTES = frozenset(f"primvars:{name}" for name in (NORMALS, CONFIDENCE, OCCLUSION))
"""Attributes of normals, confidence and occlusion."""

NODE_COLUMNS = {
    NODE_LOW: "low",
    NODE_HIGH: "high",
    NODE_ERRORS: "errors",
    NODE_FIRST_CHILD: "first_child",
    NODE_CHILD_COUNT: "child_count",
    NODE_CHUNK: "chunk",
    NODE_FIRST_ROW: "first_row",
    NODE_PROXIES: "proxies",
    NODE_RESIDENTS: "residents",
}
"""Attribute of a splat tree -> column of its `NodeTable`."""
TREE_ATTRIBUTES = frozenset({*NODE_COLUMNS, CHUNKS, CHUNK_DIGESTS, LOD_PIXEL, SH_DEGREE})
"""Attributes that determine the tree returned by `read_tree`."""

LONG_AGO = -1e6
"""Time of a sample before all frames, which holds the value before the first one [time code]. USD
26.11 evaluates array edits wrongly before the first sample."""

GRADE_ATTRIBUTES = frozenset(
    {GRADE_EXPOSURE, GRADE_TEMPERATURE, GRADE_TINT, GRADE_GAIN, GRADE_SATURATION, GRADE_MATRIX}
)
"""Attributes that determine the grade of a field."""
