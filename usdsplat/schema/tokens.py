"""Every name that splats have on a stage, written once.

Names without a prefix are the stock schema's (usdVol) or UsdGeomPoints'; names under `splat:` are
ours and declared in schema.usda.
"""

from __future__ import annotations

from typing import Literal

Form = Literal["float", "half", "packed"]
"""How a field is stored: stock float, stock half (centres stay float), or our packed type."""

STOCK_TYPE = "ParticleField3DGaussianSplat"
PRERELEASE_TYPE = "ParticleField_3DGaussianSplat"
"""What drafts of the stock schema called the type; files that say so are read."""
PACKED_TYPE = "ParticleFieldPackedSplat"
BASE_TYPE = "ParticleField"
FIELD_API = "SplatFieldAPI"
SETTINGS_API = "SplatRenderSettingsAPI"
GRADE_API = "SplatGradeAPI"
CROP_API = "SplatCropAPI"
CROP_INCLUDE = "cropInclude"
CROP_EXCLUDE = "cropExclude"
"""Collections of the volumes that a field is cropped by."""

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
PACKING = "splat:packing"
PACKED = "splat:packed"
PACKED_HARMONICS = "splat:packedHarmonics"
COLOR_RANGE = "splat:colorRange"
HARMONICS_RANGE = "splat:harmonicsRange"

GRADE_EXPOSURE = "splat:grade:exposure"
GRADE_TEMPERATURE = "splat:grade:temperature"
GRADE_TINT = "splat:grade:tint"
GRADE_GAIN = "splat:grade:gain"
GRADE_SATURATION = "splat:grade:saturation"
GRADE_MATRIX = "splat:grade:matrix"

COLOR_SPACE = "colorSpace:name"
PURPOSE = "purpose"
PROXY_PRIM = "proxyPrim"
PROXY_CHILD = "proxy"
"""Name of the Points prim beneath a packed field."""

SCHEMA_FALLBACK_DEGREE = 3
"""Degree of a prim that authors none."""

RASTERIZE_MODES = ("classic", "antialiased")
PROJECTION_MODES = ("perspective", "tangential")
SORTING_MODES = ("zDepth", "cameraDistance", "rayHitDistance")

DEFAULT_COLOR_SPACE = "srgb_rec709_scene"
"""Space of a field that names none: what captures are trained in."""
COLOR_SPACE_ALIASES = {"srgb_rec709_display": "srgb_rec709_scene"}
"""Names that others write and Gf does not know -> the name for the same numbers."""

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
"""A change of one of these changes the cloud that `fetch` returns; of no other attribute."""

LONG_AGO = -1e6
"""A sample here is no frame, but what is held before the first one [time code]; USD 26.11 takes
edits of arrays that come before all samples for what is no number."""

GRADE_ATTRIBUTES = frozenset(
    {GRADE_EXPOSURE, GRADE_TEMPERATURE, GRADE_TINT, GRADE_GAIN, GRADE_SATURATION, GRADE_MATRIX}
)
"""A change of one of these changes the grade of a field."""
