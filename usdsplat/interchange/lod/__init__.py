"""Build splat trees: captures of any size with levels of detail."""

from __future__ import annotations

from usdsplat.interchange.lod.building import begin_tree, build_part, build_tree
from usdsplat.interchange.lod.nodes import TreePart
from usdsplat.interchange.lod.options import LodOptions, LodReport

__all__ = ["LodOptions", "LodReport", "TreePart", "begin_tree", "build_part", "build_tree"]
