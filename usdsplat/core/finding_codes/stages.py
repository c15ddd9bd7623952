"""Codes of composition and drawing."""

from __future__ import annotations

from usdsplat.core.finding_codes.code import Code

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
    "bad-lod-root": Code(
        "warning",
        "an LOD root or its heuristic has a value of a wrong type",
        "correct the attribute that the sentence names",
        "all items of the root that are visible are drawn",
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
    "missing-op": Code(
        "warning",
        "a transform op in xformOpOrder has no attribute",
        "author the attribute, or remove the op from xformOpOrder",
        "the op is left out",
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
        "the numbers, the transform or the picture of a light are not usable",
        "correct the attribute that the sentence names",
    ),
    "bad-texels": Code(
        "warning",
        "pixels of the picture of a dome light are negative or not finite",
        "write the picture again without them",
        "they count as black",
    ),
    "negative-light": Code(
        "warning",
        "a channel of the product of intensity, diffuse and colour of a light is negative",
        "make it positive, or hide the light; a grade darkens splats",
        "it lights nothing there, and takes no light away",
    ),
    "extreme-light": Code(
        "warning",
        "a light is so bright that what it lights passes the largest number of half pictures",
        "correct its intensity and exposure; without normalize, a sun with angle 0.53 has an "
        "intensity of about 50,000",
        "colours of half pictures end at 65504, and other lights are lost beside it",
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
        "a light is of a type that is not supported, such as PortalLight",
        "use distant, sphere, disk, rect, cylinder or dome lights, or hide the light",
        "it does not light the surfaces",
    ),
    "unsupported-input": Code(
        "warning",
        "an input of a light, a shader or a camera is not supported",
        "remove it; the effect of a shader can be baked into diffuseColor",
        "it has no effect",
    ),
    "diffuse-surfaces": Code(
        "note",
        "materials of the stage have a roughness below 0.5, a clearcoat or a normal map, of which "
        "the first one is named",
        "draw meshes with highlights in another renderer, and give its picture to --holdout",
        "all surfaces are diffuse, without highlights and bumps",
        is_once=True,
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
}
