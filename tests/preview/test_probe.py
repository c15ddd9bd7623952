"""Tests of probing and picking pixels, with splats of known values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from tests.delegate.stages import add_camera
from tests.preview.documents import SIZE, STATE, drawn_by
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.sh import rgb_to_dc
from usdsplat.delegate.engine import Engine
from usdsplat.preview.document import Document
from usdsplat.preview.histogram import histogram
from usdsplat.preview.pacing import Quality
from usdsplat.preview.picking import REACH, in_box, pick
from usdsplat.preview.probe import probe
from usdsplat.preview.values import DisplaySettings, Look

PLACES = np.array([(-2.0, 1.0, 0.0), (1.5, -0.5, 1.0), (0.0, 2.0, -2.0)])
"""Of three small opaque balls."""
COLORS = np.array([(0.9, 0.1, 0.2), (0.1, 0.8, 0.3), (0.2, 0.3, 0.7)], np.float32)


def balls(ids=None):
    return SplatCloud(
        positions=PLACES.astype(np.float32),
        scales=np.full((3, 3), 0.12, np.float32),
        rotations=np.tile(np.float32((1, 0, 0, 0)), (3, 1)),
        opacities=np.full(3, 0.99, np.float32),
        sh=rgb_to_dc(COLORS)[:, None],
        ids=ids,
    )


def pixel(point):
    """Where the camera of `add_camera` sees a point: similar triangles."""
    x, y, z = point
    width, height = SIZE
    return (0.5 + x / (10 - z)) * width, (0.5 - y / (10 - z) * width / height) * height


@pytest.fixture
def stage():
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/World/Balls", balls(np.array([70, 80, 90])))
    add_camera(stage)
    return stage


@pytest.fixture
def opened(stage):
    document = Document(stage)
    drawn_by(document, STATE)
    yield document
    document.close()


# --- picking ---------------------------------------------------------------------------


@pytest.mark.parametrize("row", range(3))
def test_a_splat_is_picked_where_it_is(opened, row):
    """Oracle: what was authored, and similar triangles."""
    found = pick(opened, *pixel(PLACES[row]))
    assert (found.path, found.kind, found.element, found.instance) == (
        "/World/Balls", "splats", row, 0
    )  # fmt: skip
    splat = found.splat
    np.testing.assert_allclose(splat.center, PLACES[row], atol=1e-6)
    np.testing.assert_allclose(splat.world_center, PLACES[row], atol=1e-6)
    np.testing.assert_allclose(splat.color, COLORS[row], atol=1e-6)
    np.testing.assert_allclose(splat.scales, 0.12)
    assert splat.rotation == (1, 0, 0, 0) and splat.opacity == pytest.approx(0.99)
    assert (splat.sh_degree, splat.id) == (0, (70, 80, 90)[row])
    np.testing.assert_allclose(found.position, PLACES[row], atol=0.25)


def test_picking_is_exact_however_coarse_the_picture_is(opened, paced):
    """Oracle: what the full picture gives at every third pixel."""
    points = [(x + 0.5, y + 0.5) for x in range(0, SIZE[0], 3) for y in range(0, SIZE[1], 3)]
    full = [pick(opened, *point) for point in points]
    paced(Quality(scale=8.0, splats=1))
    drawn_by(opened, replace(STATE, time=1.0, is_moving=True))
    assert opened.shown.picture.scale == 8
    assert [pick(opened, *point) for point in points] == full
    assert {each.element for each in full if each} == {0, 1, 2}


def test_what_came_to_the_stage_since_the_picture_counts(opened, stage):
    """Oracle: the path, although another prim is the first by now."""
    schema.author(stage, "/Another", replace(balls(), positions=PLACES.astype(np.float32) + 100))
    assert pick(opened, *pixel(PLACES[0])).path == "/World/Balls"
    assert probe(opened, *pixel(PLACES[0])).path == "/World/Balls"


def test_what_is_near_the_pointer_is_picked_and_what_is_far_is_not(opened):
    """Oracle: the full picture's ids, and distances in pixels."""
    with Engine(opened.stage) as engine:
        ids = engine.picture(engine.view("/Camera", resolution=SIZE), aovs=("elementId",))
    rows, columns = np.nonzero(ids["elementId"] >= 0)
    for y in range(0, SIZE[1], 2):
        for x in range(0, SIZE[0], 2):
            near = np.hypot(rows - y, columns - x).min() <= REACH
            assert (pick(opened, x + 0.5, y + 0.5) is not None) == near


@pytest.mark.parametrize("point", [(-1, 5), (5, -0.5), (SIZE[0], 5), (5, SIZE[1] + 3)])
def test_nothing_is_outside_of_the_viewport(opened, point):
    """Oracle: a person, who dragged out of the window."""
    assert pick(opened, *point) is None and probe(opened, *point) is None


def test_nothing_is_there_before_the_first_picture(stage):
    """Oracle: a person, who clicked too early."""
    document = Document(stage)
    assert pick(document, 1, 1) is None and probe(document, 1, 1) is None
    assert histogram(document) is None
    document.close()


def test_instances_and_moved_prims_tell_which_and_where(stage):
    """Oracle: the matrices that were authored."""
    instancer = UsdGeom.PointInstancer.Define(stage, "/Many")
    schema.author(stage, "/Many/Proto/Balls", balls())
    instancer.CreatePrototypesRel().SetTargets(["/Many/Proto"])
    instancer.CreateProtoIndicesAttr(Vt.IntArray([0, 0]))
    shifts = ((0.0, -2.5, 0.0), (0.7, -1.2, 0.0))
    instancer.CreatePositionsAttr(Vt.Vec3fArray([Gf.Vec3f(*each) for each in shifts]))
    document = Document(stage)
    drawn_by(document, STATE)
    where = PLACES[0] + shifts[1]
    found = pick(document, *pixel(where))
    document.close()
    assert (found.instance, found.element) == (1, 0) and found.path.startswith("/Many")
    np.testing.assert_allclose(found.splat.world_center, where, atol=1e-6)
    np.testing.assert_allclose(found.splat.center, PLACES[0], atol=1e-6)


def test_a_mesh_is_picked_with_its_face(stage):
    """Oracle: the cube's face that looks at the camera."""
    UsdGeom.Cube.Define(stage, "/Cube").CreateSizeAttr(1.0)
    document = Document(stage)
    drawn_by(document, STATE)
    found = pick(document, SIZE[0] / 2, SIZE[1] / 2)
    document.close()
    assert (found.path, found.kind, found.splat) == ("/Cube", "mesh", None)
    assert found.position[2] == pytest.approx(0.5, abs=1e-4)


# --- probing ---------------------------------------------------------------------------


def test_a_probe_has_the_numbers_of_the_full_picture(opened):
    """Oracle: the whole pictures of an engine of its own; bit for bit."""
    aovs = ("color", "depth", "P", "elementId")
    with Engine(opened.stage) as engine:
        arrays = engine.picture(engine.view("/Camera", resolution=SIZE), aovs=aovs)
    drawn_by(opened, replace(STATE, look=Look(aov="Z")))
    hits = 0
    for y in range(0, SIZE[1], 4):
        for x in range(0, SIZE[0], 4):
            found = probe(opened, x + 0.7, y + 0.2)
            assert (found.x, found.y, found.aov, found.channels) == (x, y, "Z", ("Z",))
            assert found.rendered == tuple(arrays["color"][y, x].tolist())
            assert found.values == (arrays["depth"][y, x],)
            assert found.element == arrays["elementId"][y, x]
            assert found.path == ("/World/Balls" if found.element >= 0 else "")
            if found.element >= 0:
                assert found.position == tuple(arrays["P"][y, x].tolist())
                hits += 1
            else:
                assert found.position is None
    assert hits > 3


def test_a_probe_shows_what_the_screen_shows(opened, paced):
    """Oracle: the picture's own pixels, coarse ones too; what was rendered is before the view."""
    paced(Quality(scale=2.0))
    display = DisplaySettings(exposure=1.0)
    drawn_by(opened, replace(STATE, display=display, is_moving=True, time=1.0))
    image = opened.shown.picture.image
    x, y = (int(each) for each in pixel(PLACES[1]))
    found = probe(opened, x, y)
    np.testing.assert_allclose(found.shown, image[y // 2, x // 2] / 255)
    assert found.shown[1] > found.rendered[1] > found.rendered[0]


def test_a_probe_is_of_its_side_of_a_comparison(opened):
    """Oracle: the sides alone: what is white left, and where it is gone right."""
    op = UsdGeom.Xformable(opened.stage.GetPrimAtPath("/World/Balls")).AddTranslateOp()
    op.Set((0, 0, 0), 1)
    op.Set((1, 0, 0), 2)
    x, y = pixel(PLACES[0])
    state = replace(STATE, time=1.0, other=Look(time=2.0, aov="N"), wipe=0.9)
    drawn_by(opened, state)
    left = probe(opened, x, y)
    drawn_by(opened, replace(state, wipe=0.0))
    right = probe(opened, x, y)
    assert (left.aov, left.element) == ("color", 0)
    assert (right.aov, right.element, right.values) == ("N", -1, (0, 0, 0))
    moved = probe(opened, *pixel(PLACES[0] + (1, 0, 0)))
    assert moved.element == 0 and pick(opened, *pixel(PLACES[0] + (1, 0, 0))).element == 0


# --- histograms ------------------------------------------------------------------------


def test_a_histogram_counts_what_the_screen_shows(opened):
    """Oracle: NumPy's own."""
    found = histogram(opened)
    image = opened.shown.picture.image
    assert found.pixels == SIZE[0] * SIZE[1]
    for channel, counts in enumerate((found.red, found.green, found.blue)):
        expected, _ = np.histogram(image[..., channel], bins=256, range=(0, 256))
        assert list(counts) == expected.tolist()


def test_a_box_finds_the_prims_that_are_seen_in_it(stage):
    """Oracle: similar triangles: where the balls are; a box beyond the edges is cut, and what is
    hidden behind a nearer prim is not in it."""
    for path, place in (("/World/Left", (-3.0, -1.0, 0.0)), ("/World/Hidden", (-2.0, 1.0, -6.0))):
        cloud = balls()
        few = replace(
            cloud,
            **{
                name: getattr(cloud, name)[:1]
                for name in ("scales", "rotations", "opacities", "sh")
            },
            positions=np.array([place], np.float32),
        )
        schema.author(stage, path, few)
    document = Document(stage)
    drawn_by(document, STATE)
    x, y = pixel((-3.0, -1.0, 0.0))
    assert in_box(document, x - 2, y - 2, x + 2, y + 2) == ("/World/Left",)
    x, y = pixel(PLACES[1])
    assert in_box(document, x - 2, y - 2, x + 2, y + 2) == ("/World/Balls",)
    assert in_box(document, -50, -50, 500, 500)[0] == "/World/Balls"
    assert "/World/Left" in in_box(document, -50, -50, 500, 500)
    assert in_box(document, -9, -9, -1, -1) == () == in_box(document, 0, 0, 3, 3)
    document.close()
