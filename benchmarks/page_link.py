"""Measure the page of `usdsplat view --web` behind slow links, in Chromium.

    python -m benchmarks.page_link [CAPTURE]

A proxy on this machine has the bandwidth and the round trip of the link, in front of a server with
a capture of the test data. "Page" is the time from the request of the page to its first picture,
with six round trips for connections, the page and the socket; "first" is that from the page's first
message. Both are medians of three. "Frames" arrive each second while the mouse drags for 6 s, of
which the first is left out; "sharp" and "exact" are the times from its end to a picture with all
pixels, and to one bit for bit.
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import urlsplit

from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import DATA
from tests.chromium import WITHOUT_GPU, chromium
from tests.preview.web.throttle import Throttle
from usdsplat.preview.opening import open_document
from usdsplat.preview.session import Session
from usdsplat.preview.values import Opened
from usdsplat.preview.web.server import serve

CAPTURE = DATA / "splats" / "statue_angel.sog"
LINKS = ((1.0, 200.0), (4.0, 100.0), (20.0, 40.0), (1000.0, 1.0))
"""Bandwidth [Mbit/s] and round trip [ms]."""
SIZE = {"width": 1280, "height": 800}
COLUMNS = (
    "Mbit/s", "round trip [ms]", "page [ms]", "first [ms]", "frames/s", "kB/s", "sharp [ms]",
    "exact [ms]",
)  # fmt: skip
FORMATS = {"frames": ".1f"}
ROUNDS = 3
"""Times that a page is opened, of which the table has the median."""
DRAG, LEFT_OUT = 6.0, 1.0  # s
PATIENCE = 30.0  # s

_WATCH = """
window.seen = []; window.said = 0;
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (data) {
  window.said = window.said || performance.now();
  return send.call(this, data);
};
addEventListener("DOMContentLoaded", () => {
  const canvas = document.getElementById("picture");
  new MutationObserver((changes) => {
    const { number, final } = canvas.dataset;
    const width = Number(canvas.width);
    window.seen.push({ at: performance.now(), number: Number(number), final, width });
  }).observe(canvas, { attributes: true, attributeFilter: ["data-number", "data-final"] });
});
"""


def pictures(page: Any) -> list[dict[str, Any]]:
    """Return when which picture was shown [ms of the page]."""
    found: list[dict[str, Any]] = page.evaluate("() => window.seen")
    return found


def wait(page: Any, is_there: Any) -> float:
    """Wait for a picture, and return its time; infinity if it does not come."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for each in pictures(page):
            if is_there(each):
                return float(each["at"])
        page.wait_for_timeout(50)
    return float("inf")


def measure(browser: Any, url: str, mbit: float, trip: float) -> dict[str, float]:
    """Return what a page takes behind a link [ms], and its frames per second."""
    port = urlsplit(url).port or 0
    throttle = Throttle(port, bandwidth=mbit * 125e3, round_trip=1e-3 * trip)
    context = browser.new_context(viewport=SIZE)
    try:
        loads = []
        for _ in range(ROUNDS):
            page = context.new_page()
            page.set_default_timeout(1000 * PATIENCE)
            page.add_init_script(_WATCH)
            page.goto(url.replace(f":{port}/", f":{throttle.port}/"), wait_until="commit")
            first = wait(page, lambda each: True)
            loads.append((first, first - page.evaluate("() => window.said")))
            if len(loads) < ROUNDS:
                page.close()
        wait(page, lambda each: each["final"] == "true")
        full = page.evaluate("() => document.getElementById('viewport').clientWidth")
        x, y = 400, 400
        page.mouse.move(x, y)
        page.mouse.down()
        began, before = page.evaluate("() => performance.now()"), throttle.delivered
        while (now := page.evaluate("() => performance.now()")) < began + 1000 * DRAG:
            part = (now - began) / (1000 * DRAG)
            page.mouse.move(x + 300 * part, y + 40 * part)
            page.wait_for_timeout(15)
        page.mouse.up()
        bytes_used = throttle.delivered - before
        seen = [each["at"] for each in pictures(page)]
        moving = [at for at in seen if began + 1000 * LEFT_OUT < at < now]
        sharp = wait(page, lambda each: each["at"] > now and each["width"] >= full)
        exact = wait(page, lambda each: each["at"] > now and each["final"] == "true")
        return {
            "page": median(each for each, _ in loads),
            "first": median(each for _, each in loads),
            "frames": len(set(moving)) / (DRAG - LEFT_OUT),
            "kbytes": bytes_used / DRAG / 1000,
            "sharp": sharp - now,
            "exact": exact - now,
        }
    finally:
        context.close()
        throttle.close()


def main(arguments: list[str]) -> None:
    """Measure every link and print the table."""
    with Report("page_link", arguments) as report, chromium(*WITHOUT_GPU) as browser:
        path = Path(report.arguments[0]) if report.arguments else CAPTURE
        session = Session(lambda publish: open_document(path, publish=publish))
        opened = threading.Event()
        session.listen(lambda event: opened.set() if isinstance(event, Opened) else None)
        session.ask(lambda document: opened.set())
        opened.wait()
        server = serve(session)
        measure(browser, server.url, *LINKS[-1])  # kernels are compiled
        title = f"{path.name}, {SIZE['width']}x{SIZE['height']}"
        table = Table(*COLUMNS, title=title)
        for mbit, trip in LINKS:
            found = measure(browser, server.url, mbit, trip)
            report.add(scene=path.name, mbit=mbit, trip=trip, **found)
            cells = (f"{value:{FORMATS.get(name, ',.0f')}}" for name, value in found.items())
            table.add_row(f"{mbit:g}", f"{trip:g}", *cells)
        report.show(table)
        server.close()
        session.close()


if __name__ == "__main__":
    main(sys.argv[1:])
