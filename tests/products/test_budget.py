"""Tests of the memory of pictures under a limit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd

from tests.cli.conftest import ball
from tests.trees import little_tree
from usdsplat.core.errors import UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.images.frame_numbers import FileName
from usdsplat.products.budget import budget, with_node_memory
from usdsplat.products.drawing import draw_frames
from usdsplat.products.planning import plan_pictures
from usdsplat.products.preparing import DrawOptions
from usdsplat.products.request import PicturePlan, RenderRequest
from usdsplat.render import memory
from usdsplat.render.settings import NODE_MEMORY, RenderSettings
from usdsplat.render.specs import Framing

PLAN = PicturePlan(
    camera=None,
    framing=Framing(resolution=(640, 480)),
    settings=RenderSettings(lod_error=1000.0, lod_samples=1),
    aovs=("color",),
    purposes=("default",),
)
MIB = 1 << 20


def test_nodes_have_half_of_the_limit_unless_their_memory_is_chosen() -> None:
    """Oracle: closed form."""
    assert PLAN.settings.node_bytes == NODE_MEMORY * MIB
    assert with_node_memory(PLAN, None) is PLAN
    assert with_node_memory(PLAN, 6 << 30).settings.node_bytes == 3 << 30
    assert with_node_memory(PLAN, 1).settings.node_bytes == MIB
    chosen = replace(PLAN, settings=replace(PLAN.settings, node_memory=100))
    assert with_node_memory(chosen, 6 << 30) is chosen


def test_nodes_are_kept_in_what_a_picture_leaves_of_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: closed form: the limit without the estimate of all but nodes. The nodes in memory,
    after pictures of all levels, are no more, but those of the last one."""
    monkeypatch.setattr(memory, "resident", lambda: 300 * MIB)
    stage = Usd.Stage.Open(str(little_tree(tmp_path, ball(60_000))))
    fine = replace(PLAN.settings, lod_error=0.0)
    with Engine(stage, device="cpu") as engine:
        view = engine.view(framing=PLAN.framing)
        (_, tree), *_ = engine.render_scene.drawn_trees()
        sizes, one = tree.spec.table.sizes, tree.spec.splat_bytes
        root, leaves = int(sizes[0]) * one, int(sizes[3:].sum()) * one
        whole = budget(engine, PLAN, view, limit=None)
        assert whole.node_bytes is None
        cache = engine.render_scene.node_cache
        for left, kept in ((0, leaves), (leaves + root, leaves + root)):
            found = budget(engine, PLAN, view, limit=whole.estimate.total + left)
            assert found.node_bytes == root + left
            cache.most = found.node_bytes
            for settings in (PLAN.settings, fine):
                engine.picture(view, settings)
            assert cache.bytes - one <= kept <= cache.bytes  # beside the resident of the root
            cache.drop(lambda _: True)


@pytest.mark.parametrize("chosen", [{}, {"node_memory": 1}])
def test_chosen_memory_for_nodes_is_kept_under_a_limit(
    tmp_path: Path, chosen: dict[str, int]
) -> None:
    """Oracle: the picture, whose nodes take 6 MiB, and the sentence if they may have only one."""
    stage = Usd.Stage.Open(str(little_tree(tmp_path, ball(60_000))))
    settings = {"lod_error": 0.0, "lod_samples": 1, **chosen}
    request = RenderRequest(output=str(tmp_path / "a.png"), resolution=(64, 48), settings=settings)
    with Engine(stage, device="cpu") as engine:
        options = DrawOptions(memory_limit=4 << 30)
        plans = plan_pictures(engine, request)
        pictures = draw_frames(engine, plans, [1.0], source="a", options=options)
        if not chosen:
            assert len(list(pictures)) == 1
            return
        with pytest.raises(UsageError, match="--node-memory: found 1 MiB, expected at least"):
            next(pictures)


def test_a_tile_counts_in_the_limit(tmp_path: Path) -> None:
    """Oracle: closed form: 4 bytes for each channel of each pixel, which is kept until the tile is
    written; a limit below the sum is an error."""
    stage = Usd.Stage.Open(str(little_tree(tmp_path, ball(300))))
    plan = replace(PLAN, aovs=("color", "Z"))
    with Engine(stage, device="cpu") as engine:
        view = engine.view(framing=PLAN.framing)
        whole = budget(engine, plan, view, limit=None).estimate
        tile = budget(engine, plan, view, limit=None, is_tile=True)
        assert whole.kept == 0 and tile.estimate.kept == 640 * 480 * 5 * 4
        assert tile.sentence().endswith(", 5.9 MiB for the tile")
        deep = replace(plan, deep=True, aovs=("color",))
        assert budget(engine, deep, view, limit=None, is_tile=True).estimate.kept > 0
        with pytest.raises(UsageError, match="--memory-limit"):
            budget(engine, plan, view, limit=tile.estimate.kept, is_tile=True)


@pytest.mark.parametrize(("background", "each"), [((0.0, 0.0, 0.0), 12), (None, 40)])
def test_the_encoder_of_a_webp_needs_memory_for_the_whole_picture(
    monkeypatch: pytest.MonkeyPatch, background: tuple[float, float, float] | None, each: int
) -> None:
    """Oracle: closed form: the estimate of a PNG, and bytes for each pixel; a limit below is
    refused."""
    monkeypatch.setattr(memory, "resident", lambda: 300 * MIB)
    png, webp = (
        replace(PLAN, output=FileName.of(name), background=background)
        for name in ("a.png", "a.webp")
    )
    with Engine(Usd.Stage.CreateInMemory(), device="cpu") as engine:
        view = engine.view(framing=PLAN.framing)
        plain, whole = (budget(engine, plan, view, limit=None).estimate for plan in (png, webp))
        assert whole.total - plain.total == each * 640 * 480
        assert budget(engine, png, view, limit=plain.total)
        with pytest.raises(UsageError, match="--memory-limit"):
            budget(engine, webp, view, limit=301 * MIB)
