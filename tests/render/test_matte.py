"""Tests of which prims are mattes."""

from __future__ import annotations

import pytest

from usdsplat.render.matte import is_matte

RULES = (("/set", True), ("/set/hero", False), ("/set/hero/hat", True))


@pytest.mark.parametrize(
    ("path", "matte"),
    [
        ("/set", True),
        ("/set/wall", True),
        ("/set/hero", False),
        ("/set/hero/arm", False),
        ("/set/hero/hat/pin", True),
        ("/set/heroine", True),
        ("/settee", False),
        ("/other", False),
    ],
)
def test_the_longest_path_above_decides(path, matte):
    """Oracle: by hand."""
    assert is_matte(path, RULES) is matte
    assert is_matte(path, RULES[::-1]) is matte


def test_the_root_is_above_all():
    """Oracle: by hand."""
    assert is_matte("/a/b", (("/", True),))
    assert not is_matte("/a/b", (("/", True), ("/a", False)))
    assert not is_matte("/a/b", ())
