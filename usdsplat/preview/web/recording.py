"""Record the frames of a range for a page, which saves them: a movie, or PNGs in a zip.

Frames are drawn in full quality by the window's flipbook, one per task, so that pictures and other
tasks come in between. Files exist only in a temporary folder, and are packed in a thread of their
own.
"""

from __future__ import annotations

import asyncio
import shutil
import zipfile
from contextlib import ExitStack
from pathlib import Path

from usdsplat.core.cancel import CancelToken
from usdsplat.core.errors import UsageError, UsdSplatError
from usdsplat.core.scratch import scratch_folder
from usdsplat.preview.document import Document
from usdsplat.preview.saving import Flipbook
from usdsplat.preview.timeline import Timeline
from usdsplat.preview.values import ViewState
from usdsplat.preview.web.pages import Page
from usdsplat.preview.web.session_proxy import SessionProxy
from usdsplat.preview.web.stream import Download

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
        self._is_wanted = True
        self._frames = [timeline.start + number * timeline.step for number in range(count)]
        self.page = page
        self._proxy = proxy
        self._done, self._size = 0, 0
        self._packing: asyncio.Task[None] | None = None
        self._token = CancelToken()
        self._stack = ExitStack()
        self._folder = self._stack.enter_context(scratch_folder())
        self._is_movie = shutil.which("ffmpeg") is not None
        name = "recording.mp4" if self._is_movie else "frame.####.png"
        self._book = Flipbook(state, self._frames, self._folder / name, cancel=self._token)
        self._next()

    def cancel(self) -> None:
        """Stop; frames so far are sent, but nothing of a movie."""
        self._token.cancel()

    def close(self) -> None:
        """Stop and send nothing."""
        self._is_wanted = False
        self._token.cancel()
        if self._packing is not None:
            self._packing.cancel()
        self._stack.close()

    def leave(self) -> None:
        """Stop, for a page that has left: nothing is packed."""
        self._is_wanted = False
        self._token.cancel()

    def progress_for(self, page: Page) -> str:
        """Return what a page is told: frames so far, or "" if nothing of its own is recorded."""
        return "" if self.is_over or page is not self.page else self._progress

    # --- private ---------------------------------------------------------------------------

    @property
    def _progress(self) -> str:
        return f"{self._done} of {len(self._frames)}"

    def _next(self) -> None:
        self._tell(self._progress)
        self._proxy.ask(self._turn, self._turned, self._failed)

    def _turn(self, document: Document) -> bool:
        """Draw a frame, and return whether there are more; in the session's thread.

        Raises:
            UsageError: If the files are too large now.
        """
        before = len(self._book.files)
        has_more = self._book.turn(document)
        if self._is_movie:  # which grows in a file that has another name until it is finished
            files = tuple(each for each in self._folder.rglob("*") if each.is_file())
            self._size = 0
        else:
            files = self._book.files[before:]
        self._size += sum(each.stat().st_size for each in files)
        if self._size > MOST_BYTES:
            self._token.cancel()
            if has_more:
                self._book.turn(document)  # ends an unfinished movie
            found = f"{self._size} bytes after {self._done + has_more} frames"
            raise UsageError("recording", found, f"at most {MOST_BYTES}: a shorter range")
        return has_more

    def _turned(self, has_more: bool) -> None:
        if has_more:
            self._done += 1
            self._next()
            return
        self._packing = asyncio.get_running_loop().create_task(self._pack())

    async def _pack(self) -> None:
        """Send what there is, unless the page has left."""
        files = self._book.files
        try:
            if files and self._is_wanted:
                download = await asyncio.to_thread(_packed, files, self._folder)
                if self._is_wanted:
                    self.page.outbox.send(download)
        except OSError as error:
            self.page.outbox.tell("problem", f"recording: found {error}, expected its files")
        finally:
            self._end()

    def _failed(self, error: UsdSplatError) -> None:
        self._end()
        self.page.outbox.tell("problem", str(error))

    def _end(self) -> None:
        self.is_over = True
        self._stack.close()
        self._tell("")

    def _tell(self, progress: str) -> None:
        self.page.outbox.tell("recording", progress)


def _packed(files: tuple[Path, ...], folder: Path) -> Download:
    """Return a movie, or a zip of pictures, which is written to a folder first, so that memory
    holds it once."""
    if files[0].suffix != ".png":
        return Download(name=files[0].name, encoding="video/mp4", data=files[0].read_bytes())
    target = folder / "recording.zip"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for each in files:
            archive.write(each, each.name)
    return Download(name=target.name, encoding="application/zip", data=target.read_bytes())
