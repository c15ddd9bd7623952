"""Tests of pages in Chromium, which draws on the processor, opened from disk.

The oracle of pictures is `render` of the same camera, drawn from the stage. The viewer ends a splat
at 2.8 standard deviations, so pictures differ at the rims of what is opaque.
"""

from __future__ import annotations

import base64
import functools
import json
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.chromium import SOFTWARE_GL, chromium
from tests.delegate.stages import random_cloud
from tests.products.page.pages import moving_stage, parsed
from tests.render.test_sampling import psnr
from usdsplat import formats
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.lod import LodOptions, build_tree
from usdsplat.interchange.opening import open_capture
from usdsplat.products.page import PageRequest, document, write_page
from usdsplat.render.settings import RenderSettings

SIZE = (640, 480)
REQUEST = PageRequest(resolution=SIZE)
PATIENCE = 60_000
"""How long a page may take before a test fails [ms]."""
LEAST = 30.0
"""[dB]"""
GREY = 56 / 255
"""Background of captures by themselves."""
CAPTURES = ("statue_massa.sog", "guitar.compressed.ply", "playbot_lod4.sog")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window, with WebGL."""
    with chromium(*SOFTWARE_GL) as found:
        yield found


class Visit:
    """A page in a window of a browser, and what it complained about."""

    def __init__(self, browser: Any, size: tuple[int, int] = SIZE) -> None:
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.page.set_default_timeout(PATIENCE)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))

    def go(self, address: str) -> None:
        """Open a page, and wait for the first picture."""
        self.page.goto("about:blank")
        self.page.goto(address)
        self.wait()

    def wait(self) -> None:
        self.page.wait_for_function("globalThis.viewer?.state.loaded")

    def seek(self, seconds: float) -> None:
        """Show a time of the animation."""
        self.page.evaluate(
            "time => { viewer.state.animationPaused = true; viewer.seek(time); }", seconds
        )

    def picture(self) -> Any:
        """The picture when it rests, 0 to 1, shape (height, width, 3)."""
        from PIL import Image

        before, found = b"", self.page.screenshot()
        while before != found:
            self.page.wait_for_timeout(300)
            before, found = found, self.page.screenshot()
        return np.asarray(Image.open(BytesIO(found)).convert("RGB")) / 255.0

    def message(self) -> str:
        """What the page says to the user, when it does."""
        self.page.wait_for_selector("#message:not([hidden])")
        return str(self.page.text_content("#message"))

    def drop(self, path: Path) -> None:
        """Drop a file on the page."""
        self.page.evaluate(
            """([name, text]) => {
              globalThis.viewer = null;
              const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
              const dataTransfer = new DataTransfer();
              dataTransfer.items.add(new File([bytes], name));
              dispatchEvent(new DragEvent("drop", {dataTransfer, cancelable: true}));
            }""",
            [path.name, base64.b64encode(path.read_bytes()).decode()],
        )


@pytest.fixture
def visit(browser: Any) -> Iterator[Visit]:
    """A window; at its end no error was thrown in the page."""
    found = Visit(browser)
    yield found
    found.page.close()
    assert found.errors == []


@pytest.fixture
def host(tmp_path: Path) -> Iterator[str]:
    """The address of a host of static files, those of the test."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=tmp_path))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def drawn(
    stage: Usd.Stage, camera: str | None = None, time: float | None = None, behind: float = 0.0
) -> Any:
    """The picture that `render` draws for displays, over black, or another grey."""
    with Engine(stage, time=time, device="cpu") as engine:
        view = engine.view(camera, resolution=SIZE)
        found = engine.picture(view, RenderSettings(color_mode="display"))["color"]
        return np.clip(found[..., :3] + (1 - found[..., 3:]) * behind, 0, 1)


def test_a_page_shows_the_moving_camera_of_a_stage(visit, tmp_path):
    """Oracle: `render` at two frames of a camera that moves, rolls and zooms. The page asks for
    nothing but itself."""
    stage = moving_stage()
    write_page(stage, tmp_path / "page.html", request=REQUEST)
    address = (tmp_path / "page.html").as_uri()
    visit.go(f"{address}?noui&noanim")
    for frame in (1, 9):
        visit.seek((frame - 1) / 24)
        found = psnr(visit.picture(), drawn(stage, "/Camera", frame))
        print(f"frame {frame}: {found:.1f} dB")
        assert found >= LEAST
    asked = [url for url in visit.requests if not url.startswith(("about:", "blob:", "data:"))]
    assert asked == [f"{address}?noui&noanim"]


@pytest.mark.slow
@pytest.mark.parametrize("name", CAPTURES)
def test_a_page_shows_a_capture(data, visit, tmp_path, name):
    """Oracle: `render` of the capture with its automatic camera; harmonics up to degree 2."""
    source = data / "splats" / name
    write_page(source, tmp_path / "page.html", request=REQUEST)
    visit.go((tmp_path / "page.html").as_uri() + "?noui")
    found = psnr(visit.picture(), drawn(open_capture(source), behind=GREY))
    print(f"{name}: {found:.1f} dB")
    assert found >= LEAST


@pytest.mark.slow
def test_a_page_shows_antialiased_splats_from_several_pieces(data, visit, tmp_path, monkeypatch):
    """Oracle: `render` of the same splats, marked as antialiased."""
    monkeypatch.setattr(document, "CHUNK", 30_000)
    cloud = formats.read(data / "splats" / "playbot_lod4.sog").cloud
    formats.write(cloud, tmp_path / "aa.sog", how=formats.WriteOptions(antialiased=True))
    write_page(tmp_path / "aa.sog", tmp_path / "page.html", request=REQUEST)
    visit.go((tmp_path / "page.html").as_uri() + "?noui")
    found = psnr(visit.picture(), drawn(open_capture(tmp_path / "aa.sog"), behind=GREY))
    print(f"antialiased: {found:.1f} dB")
    assert found >= 35


@pytest.mark.slow
def test_a_page_shows_an_animated_stage_of_a_capture(data, visit, tmp_path):
    """Oracle: `render` at two frames."""
    stage = open_capture(data / "splats" / "playbot_lod4.sog")
    moving = moving_stage()
    for key in ("startTimeCode", "endTimeCode", "timeCodesPerSecond"):
        stage.SetMetadata(key, moving.GetMetadata(key))
    Sdf.CopySpec(moving.GetRootLayer(), "/Camera", stage.GetRootLayer(), "/Camera")
    write_page(stage, tmp_path / "page.html", request=REQUEST)
    visit.go((tmp_path / "page.html").as_uri() + "?noui&noanim")
    for frame in (3, 12):
        visit.seek((frame - 1) / 24)
        found = psnr(visit.picture(), drawn(stage, "/Camera", frame))
        print(f"frame {frame}: {found:.1f} dB")
        assert found >= LEAST


@pytest.mark.slow
def test_a_folder_streams_a_tree_from_a_host(data, visit, host, tmp_path):
    """Oracle: `render` of the tree, once its finest levels have come."""
    build_tree(
        data / "splats" / "playbot_lod4.sog",
        tmp_path / "tree.usda",
        options=LodOptions(leaf_splats=2000),
    )
    write_page(tmp_path / "tree.usda", tmp_path / "web" / "index.html", request=REQUEST)
    expected = drawn(Usd.Stage.Open(str(tmp_path / "tree.usda")))
    visit.go(f"{host}/web/index.html?noui")
    found = 0.0
    for _ in range(120):
        found = psnr(visit.picture(), expected)
        if found >= LEAST:
            break
        visit.page.wait_for_timeout(500)
    print(f"streamed: {found:.1f} dB")
    assert found >= LEAST
    assert any(url.endswith("/scene/lod-meta.json") for url in visit.requests)


@pytest.mark.slow
def test_a_folder_from_disk_says_what_to_do(browser, tmp_path):
    """Oracle: the rule of browsers, which do not read files beside a page."""
    write_page(moving_stage(), tmp_path / "web" / "index.html")
    visit = Visit(browser)
    visit.page.goto((tmp_path / "web" / "index.html").as_uri())
    assert "from a web host, not from a disk" in visit.message()


@pytest.mark.slow
def test_the_address_has_a_camera(data, visit, tmp_path):
    """Oracle: the picture before, and a view matrix by hand. V puts the camera in the address."""
    write_page(data / "splats" / "playbot_lod4.sog", tmp_path / "page.html", request=REQUEST)
    address = (tmp_path / "page.html").as_uri() + "?noui"
    visit.go(address)
    before = visit.picture()
    visit.page.keyboard.press("v")
    named = visit.page.url
    assert len(json.loads(named.partition("#")[2])) == 16
    visit.go(named)
    assert psnr(visit.picture(), before) > 50
    view = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 4, 1]  # from 4 before the origin of the file
    visit.go(f"{address}#{json.dumps(view)}")
    at = visit.page.evaluate("viewer.app.root.findByName('camera').getPosition().toArray()")
    np.testing.assert_allclose(at, (0, 0, -4), atol=1e-5)
    visit.go(f"{address}#nonsense")
    assert psnr(visit.picture(), before) > 50


@pytest.mark.slow
def test_the_address_has_a_camera_of_another_capture(data, visit, host, tmp_path):
    """Oracle: a view matrix by hand, and the picture before V put its camera into the address."""
    write_page(data / "splats" / "playbot_lod4.sog", tmp_path / "page.html", request=REQUEST)
    formats.write(random_cloud(1, n=300), tmp_path / "other.sog")
    address = f"{host}/page.html?noui&noanim&url=other.sog"
    at = "viewer.app.root.findByName('camera').getPosition().toArray()"
    view = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 9, 1]  # from (-1, 0, -9) in the file
    visit.go(f"{address}#{json.dumps(view)}")
    np.testing.assert_allclose(visit.page.evaluate(at), (1, 0, -9), atol=1e-5)
    visit.page.keyboard.press("v")
    assert json.loads(unquote(visit.page.url.partition("#")[2])) == pytest.approx(view, abs=1e-5)
    visit.go(f"{address}#nonsense")
    assert np.linalg.norm(np.subtract(visit.page.evaluate(at), (1, 0, -9))) > 0.1
    before = visit.picture()
    visit.page.keyboard.press("v")
    visit.go(visit.page.url)
    assert psnr(visit.picture(), before) > 45


@pytest.mark.slow
def test_a_drag_takes_the_camera_over(visit, tmp_path):
    """Oracle: orbiting keeps the distance to the target, and not the place."""
    write_page(moving_stage(), tmp_path / "page.html", request=REQUEST)
    visit.go((tmp_path / "page.html").as_uri() + "?noui&noanim")
    place = "viewer.app.root.findByName('camera').getPosition().toArray()"
    before = np.array(visit.page.evaluate(place))
    mouse = visit.page.mouse
    mouse.move(320, 240)
    mouse.down()
    mouse.move(420, 260, steps=8)
    mouse.up()
    visit.picture()
    after = np.array(visit.page.evaluate(place))
    assert visit.page.evaluate("viewer.state.cameraMode") in ("orbit", "fly")
    assert np.linalg.norm(after - before) > 1
    assert np.linalg.norm(after) == pytest.approx(np.linalg.norm(before), rel=0.05)


@pytest.mark.slow
def test_other_captures_are_shown(data, visit, host, tmp_path):
    """Oracle: the number of splats that the viewer has, for `?url=` and for a dropped file."""
    write_page(data / "splats" / "playbot_lod4.sog", tmp_path / "page.html", request=REQUEST)
    other = data / "splats" / "statue_massa.sog"
    (tmp_path / "other.sog").write_bytes(other.read_bytes())
    count = "viewer.app.root.findByName('gsplat').gsplat.resource.numSplats"
    visit.go(f"{host}/page.html?url=other.sog")
    assert visit.page.evaluate(count) == 58649
    visit.go((tmp_path / "page.html").as_uri())
    assert visit.page.evaluate(count) == 8406
    visit.drop(other)
    visit.wait()
    visit.page.keyboard.press("v")
    assert "is not in the page" in visit.message() and "#" not in visit.page.url
    assert visit.page.evaluate(count) == 58649
    assert visit.page.locator(".sse-viewer").count() == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("<img src=x onerror=alert(1)>.txt", "expected .ply, .compressed.ply, .sog"),
        ("bad.ply", "bad.ply: the viewer cannot read it"),
    ],
)
def test_what_cannot_be_shown_is_said_as_text(visit, tmp_path, name, said):
    """Oracle: the name, and no element of its own."""
    write_page(moving_stage(), tmp_path / "page.html")
    visit.go((tmp_path / "page.html").as_uri())
    (tmp_path / name).write_bytes(b"no capture")
    visit.drop(tmp_path / name)
    message = visit.message()
    assert said in message
    assert message.startswith(name)
    assert visit.page.locator("#message *").count() == 0


@pytest.mark.slow
@pytest.mark.parametrize("size", [(390, 844), (844, 390), (300, 300)])
def test_all_of_the_picture_is_in_windows_of_any_shape(browser, tmp_path, size):
    """Oracle: similar triangles: the picture's half width and height at distance 1, or more; also
    after the window was turned."""
    write_page(moving_stage(), tmp_path / "page.html", request=REQUEST)
    visit = Visit(browser, size)
    visit.go((tmp_path / "page.html").as_uri() + "?noui&noanim")
    seen = window_of(visit)
    visit.page.set_viewport_size({"width": size[1], "height": size[0] + 60})
    visit.picture()
    turned = window_of(visit)
    visit.page.close()
    fov = parsed(tmp_path / "page.html").data["settings"]["cameras"][0]["initial"]["fov"]
    wide = np.tan(np.radians(fov) / 2)
    high = wide * SIZE[1] / SIZE[0]
    assert min(seen[0] / wide, seen[1] / high) == pytest.approx(1, rel=1e-3)
    assert min(turned[0] / wide, turned[1] / high) == pytest.approx(1, rel=1e-3)


def window_of(visit: Visit) -> list[float]:
    """Half of the width and height of what the camera shows at distance 1."""
    found: list[float] = visit.page.evaluate(
        """() => {
          const {data} = viewer.app.root.findByName("camera").camera.projectionMatrix;
          return [1 / data[0], 1 / data[5]];
        }"""
    )
    return found
