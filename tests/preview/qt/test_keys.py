"""Tests that the table of keys is consistent."""

from __future__ import annotations

from collections import Counter

import pytest
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QApplication

from usdsplat.preview.qt.keys import KEYS, MENUS, help_html

VIEWPORT = {"A", "S", "D", "X"}
"""Keys of the viewport alone. W, E, R and Q are tools, and fly while the right button is held."""


@pytest.fixture(autouse=True)
def _(application: QApplication) -> None:
    """Key sequences need an application."""


def test_no_key_does_two_things_and_none_is_the_viewports() -> None:
    """Oracle: each sequence, as Qt spells it, counted."""
    spelled = [QKeySequence(keys).toString() for key in KEYS for keys in key.keys]
    assert all(spelled)
    assert Counter(spelled).most_common(1)[0][1] == 1
    assert not VIEWPORT & set(spelled)


def test_the_help_lists_every_key() -> None:
    """Oracle: the table."""
    page = help_html()
    for key in KEYS:
        assert key.menu in MENUS
        for each in key.keys:
            assert f"<b>{', '.join(key.keys)}</b>" in page, each
