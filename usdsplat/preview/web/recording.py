"""Record the frames of a range for a page, which saves them: a movie, or PNGs in a zip.

Frames are drawn in full quality by the window's flipbook, one per task, so that pictures and other
tasks come in between. Files exist only in a temporary folder.
"""

from __future__ import annotations

import io
import shutil
import zipfile
from contextlib import ExitStack
from pathlib import Path

from usdsplat.core.errors import UsageError, UsdSplatError
from usdsplat.core.scratch import scratch_folder
from usdsplat.preview.document import Document
from usdsplat.preview.saving import Flipbook
from usdsplat.preview.timeline import Timeline
from usdsplat.preview.values import ViewState
from usdsplat.preview.web.pages import Page
from usdsplat.preview.web.session_proxy import SessionProxy
from usdsplat.preview.web.stream import Download
from usdsplat.products.cancel import CancelToken

MOST_FRAMES = 2000
"""Most frames of a recording."""
MOST_BYTES = 2**29
"""Most bytes of a recording, which is held in memory while it is sent."""


class Recording:
    """A recording in progress; used in the server's thread.

    Args:
        state: What to draw, except for the time.
        timeline: Has the range.
        page: Gets the file, and the progress.
        proxy: Draws the frames.

    Raises:
        UsageError: If the range has too many frames.
    """

    def __init__(
        self, state: ViewState, timeline: Timeline, *, page: Page, proxy: SessionProxy
    ) -> None:
        count = int((timeline.end - timeline.start) / timeline.step + 1e-6) + 1
        if count > MOST_FRAMES:
            raise UsageError("recording", f"{count} frames", f"at most {MOST_FRAMES}")
        self.is_over = False
        self._frames = [timeline.start + number * timeline.step for number in range(count)]
        self.page = page
        self._proxy = proxy
        self._done = 0
        self._token = CancelToken()
        self._stack = ExitStack()
        self._folder = self._stack.enter_context(scratch_folder())
        name = "recording.mp4" if shutil.which("ffmpeg") else "frame.####.png"
        self._book = Flipbook(state, self._frames, self._folder / name, cancel=self._token)
        self._next()

    def cancel(self) -> None:
        """Stop; frames so far are sent, but nothing of a movie."""
        self._token.cancel()

    def close(self) -> None:
        """Stop and send nothing."""
        self._token.cancel()
        self._stack.close()

    # --- private ---------------------------------------------------------------------------

    def _next(self) -> None:
        self._tell(f"{self._done} of {len(self._frames)}")
        self._proxy.ask(self._turn, self._turned, self._failed)

    def _turn(self, document: Document) -> bool:
        """Draw a frame, and return whether there are more; in the session's thread."""
        return self._book.turn(document)

    def _turned(self, has_more: bool) -> None:
        if has_more:
            self._done += 1
            self._next()
            return
        # compressing nothing, reading what was written just now: short enough for any thread
        self._proxy.ask(lambda document: _packed(self._book.files), self._packed, self._failed)

    def _packed(self, download: Download | None) -> None:
        self._end()
        if download is not None:
            self.page.outbox.send(download)

    def _failed(self, error: UsdSplatError) -> None:
        self._end()
        self.page.outbox.tell("problem", str(error))

    def _end(self) -> None:
        self.is_over = True
        self._stack.close()
        self._tell("")

    def _tell(self, progress: str) -> None:
        self.page.outbox.tell("recording", progress)


def _packed(files: tuple[Path, ...]) -> Download | None:
    """Return a movie, or a zip of pictures; None without files."""
    if not files:
        return None
    _check_size(files)
    if files[0].suffix != ".png":
        return Download(name=files[0].name, encoding="video/mp4", data=files[0].read_bytes())
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for each in files:
            archive.write(each, each.name)
    return Download(name="recording.zip", encoding="application/zip", data=buffer.getvalue())


def _check_size(files: tuple[Path, ...]) -> None:
    size = sum(each.stat().st_size for each in files)
    if size > MOST_BYTES:
        raise UsageError("recording", f"{size} bytes", f"at most {MOST_BYTES}: a shorter range")
