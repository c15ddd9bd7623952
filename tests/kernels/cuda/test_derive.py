"""Which loops become CUDA kernels; `simulated/derived.py` runs them."""

from __future__ import annotations

import pytest

from usdsplat.kernels.cuda.derive import Underivable, derive

from . import derivable


@pytest.mark.parametrize(
    ("kernel", "reason"), [("in_turns", "more than one|not one"), ("roomy", "16384 bytes")]
)
def test_what_threads_cannot_do_is_refused(kernel: str, reason: str) -> None:
    """Oracle: a loop after another would need all threads to wait; 16 KiB for each is too much."""
    with pytest.raises(Underivable, match=reason):
        derive(getattr(derivable, kernel), 8)
