"""Use the preview's session in a script: draw pictures, pick a splat, and run a simulation.

python examples/13_preview.py [FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np
import OpenImageIO as oiio
from pxr import Usd

from usdsplat import (
    Opened,
    Picture,
    Session,
    SimulationStatus,
    ViewState,
    open_document,
    pick,
    procedural_capture,
    save_view,
    schema,
)
from usdsplat import main as usdsplat

FRAMES = 20
"""Number of simulated frames."""


def main(folder: Path) -> Path:
    """Write capture.usdc, push.usda, and a picture before and after the simulation.

    Return the folder.
    """
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(stage, "/World/Capture", procedural_capture(4_000))
    stage.Save()
    scene = folder / "push.usda"
    assert usdsplat(f"simulate --preset push {folder}/capture.usdc -o {scene}".split()) == 0

    news: Queue[Any] = Queue()
    session = Session(lambda publish: open_document(scene, publish=publish))
    session.listen(news.put)  # all events, in the session's thread

    def until(kind: type, is_it: Callable[[Any], bool] = lambda event: True) -> Any:
        while not (isinstance(event := news.get(timeout=300), kind) and is_it(event)):
            pass
        return event

    def ask(task: Callable[[Any], Any]) -> Any:
        answer: Queue[Any] = Queue()
        session.ask(task, answer.put, answer.put)  # the result, or the error
        return answer.get(timeout=300)

    try:
        opened = until(Opened)
        view = ViewState(size=(480, 360), time=opened.start)
        session.look(replace(view, is_moving=True))  # a coarse picture at once
        session.look(view)  # then a full one
        picture = until(Picture, lambda each: each.is_final)
        print(f"{opened.name}: {picture.splats} of {picture.total} splats on {picture.device}")

        picked = ask(lambda document: pick(document, 240, 200))
        print(f"in the middle: splat {picked.element} of {picked.path}")

        ask(lambda document: save_view(document, view, folder / "before.png"))
        ask(lambda document: document.simulation.run())
        last = opened.start + FRAMES - 1
        status = until(SimulationStatus, lambda each: (each.frame or 0) >= last)
        ask(lambda document: document.simulation.pause())
        print(f"frames {status.frames} can be shown")
        there = replace(view, time=last)
        ask(lambda document: save_view(document, there, folder / "after.png"))
        ask(lambda document: save_view(document, there, folder / "after.exr"))
    finally:
        session.close()
    return folder


def check(folder: Path) -> None:
    """Check that pictures are complete, that the simulation is visible, and that no file of the
    stage changed."""
    before, after = (oiio.ImageBuf(str(folder / f"{name}.png")) for name in ("before", "after"))
    first, last = (image.get_pixels(oiio.FLOAT) for image in (before, after))
    assert first.shape == last.shape == (360, 480, 3)
    moved = float(np.mean(np.abs(first - last).max(axis=-1) > 0.02))
    print(f"{moved:.1%} of the pixels have changed")
    assert moved > 0.001
    spec = oiio.ImageBuf(str(folder / "after.exr")).spec()
    assert spec.channelnames == ("R", "G", "B", "A")
    layer = Usd.Stage.Open(str(folder / "push.usda")).GetRootLayer()
    assert not layer.subLayerPaths or all("bake" not in path for path in layer.subLayerPaths)
    assert len(list(folder.iterdir())) == 5


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
