"""Whether the usdview that we are in has what our docks need; asked before any Qt is loaded."""

from __future__ import annotations

import importlib.util

from usdsplat.core.errors import BackendError

WHERE = "usdview"
NEEDED = ("numba", "OpenImageIO", "PIL")
"""Modules that are missing where usdsplat is merely on a path."""


def check(window: object) -> None:
    """Refuse a main window that our widgets cannot live in.

    Args:
        window: usdview's.

    Raises:
        BackendError: With what to do about it.
    """
    modules = (cls.__module__.partition(".")[0] for cls in type(window).__mro__)
    binding = next((name for name in modules if name.startswith("PySide")), "another Qt")
    if binding != "PySide6":
        # Two Qts in one process end it.
        raise BackendError(WHERE, f"a usdview with {binding}", "one that was built with PySide6")
    for module in NEEDED:
        if importlib.util.find_spec(module) is None:
            expected = "'pip install usdsplat[view]' in the Python that usdview runs in"
            raise BackendError(WHERE, f"a Python without {module}", expected)
