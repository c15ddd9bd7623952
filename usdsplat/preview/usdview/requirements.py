"""Check that the running usdview has what our docks need, before any Qt is imported."""

from __future__ import annotations

import importlib.util

from usdsplat.core.errors import BackendError

WHERE = "usdview"
NEEDED = ("numba", "OpenImageIO", "PIL")
"""Modules that are missing where usdsplat is only on the path, not installed."""


def check(window: object) -> None:
    """Raise an error if our widgets cannot run in this main window.

    Args:
        window: Main window of usdview.

    Raises:
        BackendError: If they cannot; the message names the cure.
    """
    modules = (cls.__module__.partition(".")[0] for cls in type(window).__mro__)
    binding = next((name for name in modules if name.startswith("PySide")), "another Qt")
    if binding != "PySide6":
        # Two Qt libraries in one process crash it.
        raise BackendError(WHERE, f"a usdview with {binding}", "one that was built with PySide6")
    for module in NEEDED:
        if importlib.util.find_spec(module) is None:
            expected = "'pip install usdsplat[view]' in the Python that usdview runs in"
            raise BackendError(WHERE, f"a Python without {module}", expected)
