"""Gaussian splats in USD pipelines.

The names in `__all__` are the public interface. Each is imported when it is first used: importing
this package loads neither `pxr` nor `numba`.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.6.0"

_MODULES = {
    "DeepImage": "images.deep_reader",
    "DrawOptions": "products.preparing",
    "Engine": "delegate.engine",
    "ExportOptions": "interchange",
    "ImportOptions": "interchange",
    "LodOptions": "interchange.lod",
    "Opened": "preview.values",
    "PageRequest": "products.page",
    "Picture": "preview.values",
    "RenderRequest": "products.request",
    "RenderSettings": "render.settings",
    "SequenceOptions": "interchange",
    "Session": "preview.session",
    "Simulation": "sim.stage.simulation",
    "SimulationStatus": "preview.values",
    "SplatCloud": "core.cloud",
    "StageLoading": "preview.opening",
    "UsdSplatError": "core.errors",
    "ViewState": "preview.values",
    "author_parameters": "sim.stage.authoring:author",
    "build_tree": "interchange.lod",
    "convert": "interchange",
    "draw_frames": "products.drawing",
    "edit": "core.edit",
    "export_capture": "interchange",
    "formats": "formats",
    "import_capture": "interchange",
    "main": "cli.main:main",
    "open_device": "kernels.devices",
    "open_document": "preview.opening",
    "pick": "preview.picking",
    "plan_pictures": "products.planning",
    "procedural_capture": "interchange.procedural:capture",
    "read_deep": "images.deep_reader",
    "save_view": "preview.saving",
    "schema": "schema",
    "write_page": "products.page",
}
"""Public name -> the module that has it, or that it is; after a colon, its name there."""

__all__ = [
    "DeepImage",
    "DrawOptions",
    "Engine",
    "ExportOptions",
    "ImportOptions",
    "LodOptions",
    "Opened",
    "PageRequest",
    "Picture",
    "RenderRequest",
    "RenderSettings",
    "SequenceOptions",
    "Session",
    "Simulation",
    "SimulationStatus",
    "SplatCloud",
    "StageLoading",
    "UsdSplatError",
    "ViewState",
    "author_parameters",
    "build_tree",
    "convert",
    "draw_frames",
    "edit",
    "export_capture",
    "formats",
    "import_capture",
    "main",
    "open_device",
    "open_document",
    "pick",
    "plan_pictures",
    "procedural_capture",
    "read_deep",
    "save_view",
    "schema",
    "write_page",
]


def __getattr__(name: str) -> Any:
    """Import a public name.

    Raises:
        AttributeError: If it is none.
    """
    place = _MODULES.get(name)
    if place is None:
        raise AttributeError(f"module 'usdsplat' has no attribute {name!r}")
    path, _, there = place.partition(":")
    module = importlib.import_module(f"usdsplat.{path}")
    if there:
        found = getattr(module, there)
    else:
        found = module if path.rpartition(".")[2] == name else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
