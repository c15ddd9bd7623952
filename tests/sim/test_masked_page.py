"""Tests that the page on simulations lists the parameters that take a mask."""

from __future__ import annotations

import re
from pathlib import Path

from usdsplat.sim.parameters import masked_parameters

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_lists_the_parameters_that_take_a_mask() -> None:
    """Oracle: the parameters' own declarations, in their order."""
    text = " ".join((ROOT / "docs" / "simulate.md").read_text(encoding="utf-8").split())
    found = re.search(r"These take a mask: (.*?)\. `primvars", text)
    assert found and found[1] == ", ".join(f"`{name}`" for name in masked_parameters())
