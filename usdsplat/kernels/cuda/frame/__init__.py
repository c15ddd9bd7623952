"""Draw a colour picture of splats on the GPU, from resident fields to a resident image.

    see       find the splats of each field that touch the view, block by block
    place     write their records, in the order of storage
    count     count the tiles that each of them touches
    -- two numbers: visible splats, pairs of splat and tile --
    sort      by depth, then resolve ties
    fill      write the pairs in order of depth
    sort      pairs by tile, stably
    blend     each tile's list, front to back

The steps before the two numbers are one CUDA graph, those after them another. The second graph is
launched at once, with the sizes of the last picture. Meanwhile the host reads the two numbers. If
the sizes were too small, it grows the buffers and launches the second graph again.
"""
