"""From stage to pictures, in Hydra's words.

    RenderIndex   owns the prims: SplatField, Instancer, Camera, RenderBuffer
    SceneDelegate answers for them and turns USD's notices into DirtyBits
    sync          pulls what is dirty into the RenderScene, which has not heard of USD
    RenderPass    draws if anything changed

`engine.Engine` holds all of it for one stage at one time. Only `scene_delegate` imports `pxr`.
"""
