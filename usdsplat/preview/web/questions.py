"""Answer what pages ask about the stage and the picture: prims, pixels, counts, a screenshot.

Tasks run in the session's thread; answers go to the page that asked.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from usdsplat.core.errors import UsageError, UsdSplatError
from usdsplat.core.scratch import scratch_folder
from usdsplat.preview.document import Document
from usdsplat.preview.histogram import histogram
from usdsplat.preview.probe import probe
from usdsplat.preview.saving import save_view
from usdsplat.preview.stage_model.prims import PrimRow, children, search
from usdsplat.preview.values import ViewState, as_json
from usdsplat.preview.viewer import Viewer
from usdsplat.preview.web import messages as m
from usdsplat.preview.web.pages import Page, Pages
from usdsplat.preview.web.session_proxy import SessionProxy
from usdsplat.preview.web.stream import Download

MOST_ROWS = 200
"""Most prims of an answer."""


def answer(
    message: m.Look, page: Page, *, pages: Pages, proxy: SessionProxy, viewer: Viewer
) -> None:
    """Answer a page's question. Of questions about the same thing the latest matters.

    Pages wait for answers about pixels, prims and counts, so these come in any case.
    """
    time = viewer.state.time

    def refuse(error: UsdSplatError) -> None:
        _refuse(message, page, error)

    def tell(kind: str, content: Any, subject: str = "") -> None:
        page.outbox.tell(kind, content, subject=subject)

    if proxy.is_overrun(page):
        refuse(overrun())
        return
    match message:
        case m.ListPrims(path=path, first=first):
            proxy.ask(
                lambda document: _rows(document, path, first, time),
                lambda content: tell("prims", content, f"{path} {first}"),
                refuse,
                key=f"prims {page.number} {path} {first}",
                asker=page,
            )
        case m.SearchPrims(text=text):
            proxy.ask(
                lambda document: search(document.stage, text, most=MOST_ROWS),
                lambda paths: tell("found", {"text": text, "paths": paths}),
                refuse,
                key=f"search {page.number}",
                asker=page,
            )
        case m.Probe(x=x, y=y):
            proxy.ask(
                lambda document: as_json(probe(document, x, y)),
                lambda probed: tell("probed", probed),
                refuse,
                key=f"probe {page.number}",
                asker=page,
            )
        case m.Count():
            proxy.ask(
                lambda document: as_json(histogram(document)),
                lambda counts: tell("histogram", counts),
                refuse,
                key=f"count {page.number}",
                asker=page,
            )
        case m.Screenshot():
            state = viewer.state
            proxy.ask(
                lambda document: _screenshot(document, state),
                partial(pages.send, page),
                refuse,
                key=f"screenshot {page.number}",
                asker=page,
            )


def overrun() -> UsageError:
    """Return the error of too many requests."""
    return UsageError("message", "too many open requests", "fewer at a time")


def _refuse(message: m.Look, page: Page, error: UsdSplatError) -> None:
    """Answer that there is no answer; about pixels and counts without a sentence."""
    match message:
        case m.Probe():
            page.outbox.tell("probed", None)
        case m.Count():
            page.outbox.tell("histogram", None)
        case m.ListPrims(path=path, first=first):
            nothing = {"path": path, "first": first, "rows": None, "has_more": False}
            page.outbox.tell("prims", nothing, subject=f"{path} {first}")
            page.outbox.tell("problem", str(error))
        case _:
            page.outbox.tell("problem", str(error))


def _rows(document: Document, path: str, first: int, time: float | None) -> Any:
    """Return some children of a prim, and whether there are more."""
    found = children(document.stage, path, time=time, first=first, most=MOST_ROWS + 1)
    return {
        "path": path,
        "first": first,
        "rows": [_row(each) for each in found[:MOST_ROWS]],
        "has_more": len(found) > MOST_ROWS,
    }


def _row(row: PrimRow) -> dict[str, Any]:
    """Return what a page shows of a prim."""
    return {
        "path": row.path,
        "name": row.name,
        "type": row.type_name,
        "is_visible": row.is_visible,
        "can_hide": row.is_imageable and row.is_active and not row.is_in_instance,
        "is_active": row.is_active,
        "has_children": row.has_children,
    }


def _screenshot(document: Document, state: ViewState) -> Download:
    """Return what the window's screenshot writes."""
    with scratch_folder() as folder:
        data = save_view(document, state, folder / "screenshot.png").read_bytes()
    return Download(name="screenshot.png", encoding="image/png", data=data)
