"""A picture of plain splats on the GPU, from resident fields to a resident image.

    see       which splats of each field touch the view, block after block
    place     their records, one after the other in the order of storage
    count     the tiles that each touches
    -- two numbers: splats seen, pairs of splat and tile --
    sort      by depth, and settle what it leaves undecided
    fill      pairs in order of depth
    sort      pairs by tile, stably
    blend     each tile's list, front to back

All before the two numbers is one CUDA graph, all after them another. The second is launched at once
with the sizes of the last picture; the host reads the numbers meanwhile, and launches it again only
where they did not fit. Buffers grow with them.
"""
