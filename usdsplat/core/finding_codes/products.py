"""Codes of render products and of misspelt names."""

from __future__ import annotations

from usdsplat.core.finding_codes.code import Code

CODES: dict[str, Code] = {
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
    "flat-settings": Code(
        "note",
        "settings apply to deep pictures only",
        "request a deep picture, with --deep or a product of type deepRaster",
        "they have no effect on a flat picture",
    ),
    "unsupported-name": Code(
        "note",
        "a RenderVar names channels otherwise than usdsplat does",
        "rename the channels in compositing, or author sourceName",
        "the channels have the names of the AOV",
    ),
    "png-aovs": Code(
        "warning",
        "a PNG, JPEG or WebP holds only color",
        "name an EXR for the other AOVs",
        "the others are left out",
    ),
    "unused-config": Code(
        "note",
        "the variable OCIO names a config, but a picture for displays has no OCIO view",
        "give --view or --bake-view, or author splat:ocioView",
        "the picture has plain sRGB",
    ),
    "rendering-space": Code(
        "warning",
        "the renderingColorSpace of the settings is not a linear space that pictures can have",
        "name a linear space, or author splat:workingSpace",
        "splat:workingSpace is used",
    ),
    "unused-view": Code(
        "note",
        "an OCIO view or config is named for a picture that is not drawn through a view",
        "give --bake-view, or --color-mode inverseView",
        "it has no effect",
    ),
    "product-metadata": Code(
        "warning",
        "a RenderProduct asks for a header entry, a compression or an option of another program's "
        "writer that pictures cannot have",
        "author what the sentence expects, or remove the attribute",
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
    "small-budget": Code(
        "warning",
        "a splat budget is less than what the coarsest levels of the splat trees in view need",
        "raise the budget to the number in the sentence",
        "it is exceeded",
    ),
    "unread-nodes": Code(
        "warning",
        "a picture does not wait for the nodes of splat trees, and some were not read yet",
        "leave out --no-node-wait, or author splat:nodeWait true",
        "coarser ones are drawn in their place",
    ),
    "repeated-element-ids": Code(
        "warning",
        "a picture has the element ids of a splat tree with more splats and proxies than ids of 32 "
        "bits",
        "divide the tree, or tell splats apart by primId and instanceId only",
        "some splats of the tree have the same id",
    ),
    "no-lights": Code(
        "warning",
        "shadows, or AOVs of light, are requested of a stage without lights",
        "add a light, or make one visible",
        "nothing casts shadows, and no light arrives",
    ),
    "unused-catcher": Code(
        "note",
        "a shadow catcher is named for a picture without the AOV shadow",
        "give --aovs color,shadow and an EXR; what only hides what is behind it is a --matte",
        "it hides what is behind it, and its shadow is not written",
    ),
    "links-nothing": Code(
        "note",
        "the collection lightLink of a light has neither the root nor any other member",
        "add a target to collection:lightLink:includes, or hide the light",
        "it lights nothing",
    ),
    "few-light-samples": Code(
        "note",
        "the samples of a distant light are more than 5 degrees apart",
        "raise --light-samples to the number in the sentence, or make the angle smaller",
        "its penumbra shows them as steps",
    ),
    "estimated-light": Code(
        "note",
        "a field is relit whose photographs' light is not named",
        "name it in splat:lighting:captured; usdsplat relight says how well the estimate fits",
        "the light is estimated from the colours of the splats",
    ),
    "instanced-light": Code(
        "warning",
        "a field with several native instances is relit, and a light of its photographs is inside "
        "one of them",
        "name a light outside of the instances, or make them not instanceable",
        "all instances have been photographed in this one light, which does not turn with them",
    ),
    "split-lighting": Code(
        "warning",
        "native instances of one field or tree are in collections of different light",
        "put them in one collection, or make them not instanceable",
        "all of them have the light of the first one",
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
        "a property in the namespace splat: or splatSim:, or an input of a light or shader, has an "
        "unknown name",
        "correct the name, or remove the property",
    ),
}
