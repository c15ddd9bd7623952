"""One stage that is being looked at, and all that belongs to it; for one thread at a time.

`Session` hands it from task to task. Nothing outside of tasks touches the stage, but for a
simulation, which takes `lock` for as long as it reads or writes it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from pxr import Usd

from usdsplat.delegate.engine import Engine
from usdsplat.preview.values import Event, Opened, ViewState


class Document:
    """A stage and what is drawn of it.

    Args:
        stage: What is looked at. Edits go to its session layer.
        path: Where it came from; None for one that was handed over.
        device, threads: As `Engine` takes them.
        publish: Told what happens.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        *,
        path: Path | None = None,
        device: str = "auto",
        threads: int | None = None,
        publish: Callable[[Event], None] = lambda event: None,
    ) -> None:
        self.stage = stage
        self.path = path
        self.lock = threading.RLock()
        """Held by whoever reads or writes the stage."""
        self.publish = publish
        self.wake: Callable[[], None] = lambda: None
        """Tells the session that the stage may have changed; callable from any thread."""
        self.engine = Engine(stage, device=device, threads=threads)

    def opened(self) -> Opened:
        """What a window should know first."""
        raise NotImplementedError

    def draw(self, state: ViewState) -> bool:
        """Draw and publish a picture, unless the last one was this; whether a better one follows.

        Raises:
            UsdSplatError: If the state asks for what cannot be drawn.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Let go of everything."""
        self.engine.close()
