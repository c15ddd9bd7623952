"""Read and write splat fields on USD stages: the stock type, our packed type, and splat trees.

Importing this package registers our schemas with USD. Import it before the first stage is opened.
The import never fails: `registration` describes what happens if it comes too late.
"""

from __future__ import annotations

from usdsplat.schema import registration, tokens
from usdsplat.schema.extent import compute_extent
from usdsplat.schema.field import (
    author,
    error_bounds,
    fetch,
    fetch_packed,
    form_of,
    is_packed,
    is_splat_field,
    is_time_varying,
    sample_times,
)
from usdsplat.schema.grading import author_grade, grade, has_grade, is_grade_varying
from usdsplat.schema.hints import (
    DrawingHints,
    captured_lights,
    color_space,
    footprint,
    is_known_color_space,
    is_shadow_catcher,
    lighting_mode,
    projection_mode,
    rasterize_mode,
    sorting_mode,
)
from usdsplat.schema.lod_root_authoring import author_lod_root
from usdsplat.schema.lod_roots import is_lod_root, read_lod_root
from usdsplat.schema.packing import harmonics_width
from usdsplat.schema.proxy import place as place_proxy
from usdsplat.schema.proxy import settle as settle_proxy
from usdsplat.schema.radiance_overs import author_captured, author_radiance
from usdsplat.schema.surface_primvars import (
    SurfacePrimvars,
    author_surface,
    fetch_surface,
    has_normals,
)
from usdsplat.schema.tokens import DATA_ATTRIBUTES, GRADE_ATTRIBUTES, Form
from usdsplat.schema.tree import (
    Tree,
    author_tree,
    is_tree,
    read_chunk,
    read_packed_chunk,
    read_tree,
)
from usdsplat.schema.validation import Finding, broken_rules, validate
from usdsplat.schema.vt import empty

registration.register()

__all__ = [
    "DATA_ATTRIBUTES",
    "GRADE_ATTRIBUTES",
    "DrawingHints",
    "Finding",
    "Form",
    "SurfacePrimvars",
    "Tree",
    "author",
    "author_captured",
    "author_grade",
    "author_lod_root",
    "author_radiance",
    "author_surface",
    "author_tree",
    "broken_rules",
    "captured_lights",
    "color_space",
    "compute_extent",
    "empty",
    "error_bounds",
    "fetch",
    "fetch_packed",
    "fetch_surface",
    "footprint",
    "form_of",
    "grade",
    "harmonics_width",
    "has_grade",
    "has_normals",
    "is_grade_varying",
    "is_known_color_space",
    "is_lod_root",
    "is_packed",
    "is_shadow_catcher",
    "is_splat_field",
    "is_time_varying",
    "is_tree",
    "lighting_mode",
    "place_proxy",
    "projection_mode",
    "rasterize_mode",
    "read_chunk",
    "read_lod_root",
    "read_packed_chunk",
    "read_tree",
    "sample_times",
    "settle_proxy",
    "sorting_mode",
    "tokens",
    "validate",
]
