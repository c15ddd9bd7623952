"""Render stages, with Hydra's terms.

    RenderIndex   owns the prims: SplatField, Instancer, Camera, RenderBuffer
    SceneDelegate provides their data and turns USD's notices into DirtyBits
    sync          pulls dirty data into the RenderScene, which is independent of USD
    RenderPass    draws if anything changed

`engine.Engine` holds all of it for one stage at one time. Only `scene_delegate` imports `pxr`.
"""
