"""Tests of samples of fields that validation checks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pxr import Usd

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.schema.validation.finding import Sample


def test_a_value_is_read_once_for_all_checks_of_a_time() -> None:
    """Oracle: an edit between two uses, which only a new sample sees; another time is another
    sample."""
    stage = Usd.Stage.CreateInMemory()
    prim = schema.author(stage, "/Splats", cloud(n=3))
    opacities = prim.GetAttribute("opacities")
    sample = Sample(prim, Usd.TimeCode.Default())
    before = sample.numbers("opacities").copy()
    opacities.Set([0.125] * 3)
    np.testing.assert_array_equal(sample.numbers("opacities"), before)
    np.testing.assert_array_equal(Sample(prim, sample.code).numbers("opacities"), [0.125] * 3)
    opacities.Set([0.25] * 3, 1)
    later = replace(sample, code=Usd.TimeCode(1))
    np.testing.assert_array_equal(later.numbers("opacities"), [0.25] * 3)
