"""Levels of detail: choose, load and draw the nodes of splat trees.

tree       the value that describes a tree to the render scene
measure    projected errors of nodes, and which nodes a view can show
cut        the nodes that a picture draws, chosen across all trees
cache      splats of nodes, read by threads and kept for a while
stand_ins  coarser nodes in place of nodes that are not read
gathering  trees and screens of all samples of a picture
nodes      the nodes of one picture: its cut, their splats, and its samples
memory     the estimate of a picture's memory
"""
