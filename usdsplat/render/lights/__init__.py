"""Light surfaces and captures by the lights of the stage, with shadows.

specs       a light of the stage, as a value
dome        the sky of a dome: a smooth part, and peaks as lights of their own
sampling    a light as a number of directions or points
cameras     a sample as a camera that sees the scene
depth_map   what this camera sees: lists of splats by tile, and depths of surfaces
captured    the light in which a capture was photographed, estimated
gains       factors on the colours of splats
light_maps  the light of one light at receivers, with the maps that are kept
trees       splat trees as lights see them: a cut of their own, and its normals
targets     the splats that receive light: fields, nodes of trees, and these cuts
lighting    light of receivers: splats, which keep it, and pixels of surfaces
needs       which pictures depend on lights and shadows
memory      what they take
"""
