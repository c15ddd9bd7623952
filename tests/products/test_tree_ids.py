"""Tests of the element ids of splat trees with more splats than ids."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from tests.cli.conftest import ball
from tests.render.rendering import random_cloud
from tests.trees import little_tree
from usdsplat.delegate.engine import Engine
from usdsplat.products.remarks import repeated_ids
from usdsplat.products.request import PicturePlan
from usdsplat.render.draw_list import draw_list
from usdsplat.render.fields import Field
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import FieldSpec, Framing, InstanceSpec


@pytest.mark.parametrize(
    ("first", "expected"),
    [
        (0, 0),
        (2**31 - 100, 2**31 - 100),  # the last splat has the largest id
        (2**31 - 99, 0),
        (2**31 + 5, 104),
        (2**40, 2**40 % (2**31 - 99)),
    ],
)
def test_ids_repeat_and_are_never_negative(first: int, expected: int) -> None:
    """Oracle: by hand: 100 splats have ids of 0 to 2^31 - 1, their own ones as long as they fit."""
    spec = FieldSpec(cloud=random_cloud(1, 100))
    here = InstanceSpec(path="/a", transform=tuple(np.eye(4).ravel()))
    found = draw_list([("/a", Field(spec, first_element=first), here)], ())
    numbers = found.first_elements if len(found.first_elements) else np.zeros(1, np.int32)
    assert numbers.dtype == np.int32 and numbers.tolist() == [expected]
    assert expected >= 0 and expected + 99 < 2**31


@pytest.mark.parametrize("count", [2**31 - 200, 2**31 + 7])
def test_a_picture_with_ids_says_that_they_repeat(tmp_path: Path, count: int) -> None:
    """Oracle: the number in the table, by hand; a picture without ids says nothing."""
    path = little_tree(tmp_path, ball(100))
    stage = Usd.Stage.Open(str(path))
    attribute = stage.GetPrimAtPath("/tree/splats").GetAttribute("splat:nodeProxies")
    proxies = list(attribute.Get())
    total = sum(proxies) + 1
    attribute.Set([*proxies[:-1], proxies[-1] + count - total])
    plan = PicturePlan(
        camera=None, framing=Framing(), settings=RenderSettings(), aovs=("color", "elementId"),
        purposes=(),
    )  # fmt: skip
    with Engine(stage, device="cpu") as engine:
        engine.sync()
        found = list(repeated_ids(engine, plan))
        assert list(repeated_ids(engine, replace(plan, aovs=("color",)))) == []
    if count <= 2**31:
        assert found == []
        return
    (one,) = found
    assert (one.code, one.path) == ("repeated-element-ids", "/tree/splats")
    assert one.severity == "warning"  # the picture is right, but for its ids
    assert one.found == f"{count} splats" and one.expected.startswith("at most 2147483648")
