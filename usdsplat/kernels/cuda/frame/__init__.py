"""A picture of plain splats on the GPU, from resident fields to a resident image.

    see       which splats of each field touch the view, block after block
    place     their records, one after the other in the order of storage
    count     the tiles that each touches
    -- the host reads two numbers: splats seen, pairs of splat and tile --
    sort      by depth
    fill      pairs in order of depth
    sort      pairs by tile, stably
    blend     each tile's list, front to back

All before the two numbers is one CUDA graph, all after them another: a frame costs the host two
launches. Buffers grow where a number does not fit, and the frame is done again.
"""
