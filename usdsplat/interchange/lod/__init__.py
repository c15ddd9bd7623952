"""Build splat trees: captures of any size with levels of detail."""

from __future__ import annotations

from usdsplat.interchange.lod.building import build_tree, inspect, take_step
from usdsplat.interchange.lod.nodes import TreeStep
from usdsplat.interchange.lod.options import LodOptions, LodReport

__all__ = ["LodOptions", "LodReport", "TreeStep", "build_tree", "inspect", "take_step"]
