"""Tests of whole trees: their splats, their tables, and that they are the same however built."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.interchange.lod.worlds import ground, tree_bytes
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.errors import OutputError, StageError, UsageError
from usdsplat.core.extent import extent
from usdsplat.core.node_table import NESTED, NodeTable, check_nodes
from usdsplat.interchange.lod import LodOptions, build_tree, building, sorting
from usdsplat.interchange.lod.options import MEMORY
from usdsplat.kernels.device import CpuDevice

SMALL = LodOptions(leaf_splats=256)


@pytest.fixture
def scan(tmp_path):
    """A capture of 3000 splats."""
    formats.write(ground(3000, 1), tmp_path / "scan.ply")
    return tmp_path / "scan.ply"


def values(prim, name):
    """An array of a tree."""
    return np.asarray(prim.GetAttribute(f"splat:{name}").Get())


def opened(path):
    """The stage of a tree, its table, and the splats of its chunks."""
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetDefaultPrim().GetChild("splats")
    table = NodeTable(
        low=values(prim, "nodeLow"),
        high=values(prim, "nodeHigh"),
        errors=values(prim, "nodeErrors"),
        first_child=values(prim, "nodeFirstChild"),
        child_count=values(prim, "nodeChildCount"),
        chunk=values(prim, "nodeChunk"),
        first_row=values(prim, "nodeFirstRow"),
        proxies=values(prim, "nodeProxies"),
        residents=values(prim, "nodeResidents"),
    )
    chunks = []
    for asset in prim.GetAttribute("splat:chunks").Get():
        layer = Usd.Stage.Open(asset.resolvedPath)
        chunks.append(schema.fetch(layer.GetDefaultPrim()))
    return stage, table, chunks


def splats_of(table, chunks, node):
    """The proxies and residents of a node."""
    first = table.first_row[node]
    rows = np.arange(first, first + table.proxies[node] + table.residents[node])
    return edit.take(chunks[table.chunk[node]], rows)


def test_errors_are_at_least_the_pixel(scan, tmp_path):
    """From closer than the pixel of the photographs, leaves are drawn. Oracle: the given pixel; one
    nearly as large as the capture still gives a finite error."""
    for pixel in (0.5, 1.9):
        options = LodOptions(leaf_splats=2048, pixel=pixel)
        report = build_tree(scan, tmp_path / "t.usda", options=options)
        _, table, _ = opened(tmp_path / "t.usda")
        inner = table.errors[table.child_count > 0]
        assert pixel <= inner.min() * (1 + 1e-6) and np.isfinite(inner).all()
        assert report.errors[0] == inner.min()


def test_leaves_and_residents_are_the_capture(scan, tmp_path):
    """Oracle: the capture: its positions are exact, other values within the packed form."""
    report = build_tree(scan, tmp_path / "t.usda", options=SMALL)
    _, table, chunks = opened(tmp_path / "t.usda")
    parts = []
    for node in range(len(table)):
        own = splats_of(table, chunks, node)
        first = 0 if table.child_count[node] == 0 else int(table.proxies[node])
        parts.append(edit.take(own, np.arange(first, len(own))))
    found, source = edit.merge(parts), formats.read(scan).cloud
    order, expected = (np.lexsort(cloud.positions.T) for cloud in (found, source))
    assert report.splats == len(found) == 3000
    np.testing.assert_array_equal(found.positions[order], source.positions[expected])
    np.testing.assert_allclose(found.scales[order], source.scales[expected], rtol=4e-4)
    np.testing.assert_allclose(found.opacities[order], source.opacities[expected], atol=1 / 1022)


def test_the_table_is_valid_and_its_boxes_contain_the_splats(scan, tmp_path):
    """Oracle: `check_nodes`, and the extent of the splats of each node."""
    build_tree(scan, tmp_path / "t.usda", options=SMALL)
    _, table, chunks = opened(tmp_path / "t.usda")
    check_nodes(table, "t", chunks=len(chunks))
    for node in range(len(table)):
        box = extent(splats_of(table, chunks, node))
        assert (table.low[node] <= box[0] + 1e-6).all() and (
            box[1] - 1e-6 <= table.high[node]
        ).all()
    used = np.zeros([len(chunks), 3000], int)
    for node in range(len(table)):
        first = table.first_row[node]
        used[table.chunk[node], first : first + table.proxies[node] + table.residents[node]] += 1
    assert [int(row.sum()) for row in used] == [len(chunk) for chunk in chunks]
    assert used.max() == 1


def test_each_level_has_a_quarter_of_the_one_below(scan, tmp_path):
    """Oracle: the number of splats of the children of each node, residents included."""
    build_tree(scan, tmp_path / "t.usda", options=SMALL)
    _, table, _ = opened(tmp_path / "t.usda")
    parents = table.parents()
    inner = np.flatnonzero(table.child_count)
    for node in inner:
        children = parents == node
        below = int((table.proxies + table.residents)[children].sum())
        assert table.proxies[node] == min(256, -(-below // 4))
        assert table.errors[node] >= NESTED * table.errors[children].max()
    assert table.proxies.max() <= 256
    assert table.child_count.max() <= 4
    siblings = {tuple(table.chunk[parents == node]) for node in inner}
    assert all(len(set(each)) == 1 for each in siblings)


def test_the_stage_is_a_model_with_origin_and_bounds(scan, tmp_path):
    """Oracle: the metadata of an import of the same capture."""
    report = build_tree(scan, tmp_path / "t.usda", options=LodOptions(axes="rdf"))
    stage, table, _ = opened(tmp_path / "t.usda")
    model = stage.GetDefaultPrim()
    prim = model.GetChild("splats")
    assert (str(prim.GetPath()), prim.GetTypeName()) == ("/t/splats", "ParticleFieldSplatTree")
    assert Usd.ModelAPI(model).GetKind() == "component"
    assert schema.color_space(prim) == "srgb_rec709_scene"
    assert schema.rasterize_mode(prim) == "classic"
    assert prim.GetCustomDataByKey("usdsplat")["source"] == "scan.ply"
    assert report.axes == "rdf to rub by xformOp:transform:axes"
    hint = np.array(UsdGeom.ModelAPI(model).GetExtentsHint())
    turned = [table.low[0] * (1, -1, -1), table.high[0] * (1, -1, -1)]
    np.testing.assert_allclose(hint[:2], np.sort(turned, axis=0), rtol=1e-6)


def test_a_small_capture_is_one_leaf_below_a_small_root(tmp_path):
    """Oracle: closed form: 5000 splats in one leaf, then at most 4096 in the root."""
    formats.write(ground(5000), tmp_path / "s.ply")
    report = build_tree(tmp_path / "s.ply", tmp_path / "t.usda")
    _, table, _ = opened(tmp_path / "t.usda")
    assert (report.nodes, report.leaves, report.chunks) == (2, 1, 1)
    assert table.proxies.tolist() == [1250, 5000]
    formats.write(ground(50), tmp_path / "s.ply")
    report = build_tree(tmp_path / "s.ply", tmp_path / "t.usda")
    assert (report.nodes, report.splats, report.errors) == (1, 50, (0.0, 0.0))


def test_a_splat_that_is_large_for_its_leaf_is_a_resident(tmp_path):
    """Oracle: a disc as large as the whole world belongs to the node above all leaves."""
    cloud = ground(3000)
    cloud.scales[7] = 1.0, 0.01, 1.0
    formats.write(cloud, tmp_path / "s.ply")
    report = build_tree(tmp_path / "s.ply", tmp_path / "t.usda", options=SMALL)
    _, table, chunks = opened(tmp_path / "t.usda")
    (node,) = np.flatnonzero(table.residents)
    assert report.residents == 1
    assert table.parents()[node] == -1 or table.child_count[table.parents()[node]] == 1
    resident = edit.take(splats_of(table, chunks, node), np.array([table.proxies[node]]))
    np.testing.assert_array_equal(resident.positions[0], cloud.positions[7])


def test_memory_and_threads_do_not_matter(scan, tmp_path, monkeypatch):
    """Oracle: the bytes of the files."""
    build_tree(scan, tmp_path / "t.usda", options=SMALL)
    expected = tree_bytes(tmp_path / "t.usda")
    monkeypatch.setattr(sorting, "LEAST_ROWS", 700)
    monkeypatch.setattr(sorting, "SHARE", MEMORY)
    monkeypatch.setattr(building, "open_device", lambda task: CpuDevice(threads=1))
    build_tree(scan, tmp_path / "t.usda", options=SMALL)
    assert tree_bytes(tmp_path / "t.usda") == expected


def test_tiles_are_like_one_capture(scan, tmp_path):
    """Oracle: the chunks of a tree of all splats in one file, in the same order."""
    whole, tiles = ground(3000, 1), []
    for number, rows in enumerate(np.array_split(np.arange(3000), 3)):
        tiles.append(tmp_path / f"tile{number}.ply")
        formats.write(edit.take(whole, rows), tiles[-1])
    one = LodOptions(leaf_splats=256, axes="rdf", pixel=0.001)
    build_tree(scan, tmp_path / "a.usda", options=one)
    build_tree(tiles, tmp_path / "b.usda", options=one)
    first, second = tree_bytes(tmp_path / "a.usda"), tree_bytes(tmp_path / "b.usda")
    cubes = {name for name in first if name.endswith(".usdc")}
    assert len(cubes) > 3
    assert {n: b for n, b in first.items() if n in cubes} == {
        n: b for n, b in second.items() if n in cubes
    }


class Stop:
    """Progress that interrupts the work at its n-th step."""

    def __init__(self, steps):
        self.steps = steps

    def step(self, label, done, total):
        self.steps -= 1
        if self.steps == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize("steps", [1, 4, 8, 11, 14])
def test_an_interrupted_building_continues(scan, tmp_path, steps):
    """Oracle: the bytes of a building that was not interrupted."""
    build_tree(scan, tmp_path / "t.usda", options=SMALL)
    expected = tree_bytes(tmp_path / "t.usda")
    with pytest.raises(KeyboardInterrupt):
        build_tree(scan, tmp_path / "t.usda", options=SMALL, progress=Stop(steps))
    assert tree_bytes(tmp_path / "t.usda") == expected  # the earlier tree is in place
    report = build_tree(scan, tmp_path / "t.usda", options=SMALL)
    assert report.continued == (steps > 1)
    assert tree_bytes(tmp_path / "t.usda") == expected
    assert not (tmp_path / ".t.usda.building").exists()


@pytest.mark.parametrize("change", ["options", "input"])
def test_another_job_starts_afresh(scan, tmp_path, change):
    """Oracle: the report, and the bytes of a building of its own."""
    with pytest.raises(KeyboardInterrupt):
        build_tree(scan, tmp_path / "t.usda", options=SMALL, progress=Stop(8))
    assert (tmp_path / ".t.usda.building").is_dir()
    options = LodOptions(leaf_splats=512) if change == "options" else SMALL
    if change == "input":
        formats.write(ground(2000), scan)
    report = build_tree(scan, tmp_path / "t.usda", options=options)
    assert not report.continued
    found = tree_bytes(tmp_path / "t.usda")
    build_tree(scan, tmp_path / "t.usda", options=options)
    assert tree_bytes(tmp_path / "t.usda") == found


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")
def test_a_killed_building_continues(tmp_path, monkeypatch):
    """Oracle: the bytes of a building that was not killed."""
    formats.write(ground(30_000), tmp_path / "scan.ply")
    target, work = tmp_path / "t.usda", tmp_path / ".t.usda.building"
    command = [sys.executable, "-m", "usdsplat", "lod", "scan.ply", "-o", "t.usda"]
    command += ["--leaf-splats", "256", "-q"]
    quiet = {"cwd": tmp_path, "env": {**os.environ, "USDSPLAT_SUPERVISE": "0"}}
    process = subprocess.Popen(command, **quiet)
    until = time.monotonic() + 300
    while len(list(work.glob("chunks/*.npz"))) < 5 and process.poll() is None:
        assert time.monotonic() < until
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not target.exists()
    options = LodOptions(leaf_splats=256)
    monkeypatch.chdir(tmp_path)
    assert build_tree("scan.ply", "t.usda", options=options).continued
    found = tree_bytes(target)
    build_tree("scan.ply", "t.usda", options=options)
    assert tree_bytes(target) == found


def test_a_stage_is_taken_in_world_space(tmp_path):
    """Oracle: the positions of the field after its transform, in Z-up coordinates."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    cloud = ground(400)
    for name, form in (("a", "float"), ("b", "packed")):
        prim = schema.author(stage, f"/World/{name}", cloud, form=form)
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(10 * (name == "b"), 0, 5))
    stage.GetRootLayer().Save()
    report = build_tree(tmp_path / "shot.usda", tmp_path / "t.usda")
    stage, _, (found,) = opened(tmp_path / "t.usda")
    prim = stage.GetDefaultPrim().GetChild("splats")
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert (report.splats, report.frame) == (800, "rfu")
    assert not UsdGeom.Xformable(prim).GetOrderedXformOps()
    moves = np.array([[0, 0, 5], [10, 0, 5]])
    expected = (cloud.positions + moves[:, None]).reshape(-1, 3)
    order, right = (np.lexsort(np.round(p, 3).T) for p in (found.positions, expected))
    np.testing.assert_allclose(found.positions[order], expected[right], atol=2e-6)


def test_degrees_are_raised_to_the_highest_or_bounded(tmp_path):
    """Oracle: the degree of the packed splats."""
    formats.write(ground(100, 0), tmp_path / "a.ply")
    formats.write(ground(100, 2), tmp_path / "b.ply")
    both = [tmp_path / "a.ply", tmp_path / "b.ply"]
    assert build_tree(both, tmp_path / "t.usda").degree == 2
    assert opened(tmp_path / "t.usda")[2][0].sh_degree == 2
    assert build_tree(both, tmp_path / "t.usda", options=LodOptions(sh_degree=1)).degree == 1
    assert opened(tmp_path / "t.usda")[2][0].sh_degree == 1


def test_splats_that_are_not_finite_are_left_out(tmp_path):
    """Oracle: the number of the others, and a note."""
    cloud = ground(100)
    cloud.positions[3, 1], cloud.opacities[5] = np.inf, np.nan
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    schema.author(stage, "/a", cloud)
    stage.GetRootLayer().Save()
    report = build_tree(tmp_path / "s.usda", tmp_path / "t.usda")
    assert report.splats == 98
    said = "splats dropped because a number is not finite or the rotation is zero: 2"
    assert said in report.notes


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "rows", "value"),
    [
        ("positions", slice(0, 2), 3e38),
        ("positions", slice(None), 1.5),
        ("rotations", slice(0, 50), 0.0),
        ("scales", slice(0, 50), -0.01),
        ("scales", slice(None), 0.0),
        ("scales", slice(0, 3), 1e30),
        ("scales", slice(None), 100.0),
        ("opacities", slice(None), 0.0),
        ("sh", slice(0, 5), 1e30),
    ],
)
def test_any_finite_numbers_make_a_valid_tree(tmp_path, name, rows, value):
    """Oracle: `check_nodes`, and the number of splats."""
    cloud = ground(1500, 1)
    getattr(cloud, name)[rows] = value
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usdc"))
    schema.author(stage, "/a", cloud)
    stage.GetRootLayer().Save()
    report = build_tree(tmp_path / "s.usdc", tmp_path / "t.usda", options=SMALL)
    _, table, chunks = opened(tmp_path / "t.usda")
    check_nodes(table, "t", chunks=len(chunks))
    assert report.splats == 1500


def test_other_files_are_not_replaced(scan, tmp_path):
    """Oracle: the sentences, and the files."""
    (tmp_path / "t_chunks").mkdir()
    (tmp_path / "t_chunks" / "mine.txt").write_text("x")
    for target, said in (
        ("t.usda", "t_chunks: found something that is not a folder of chunks"),
        ("t.usdz", "a package, expected a .usd, .usda or .usdc file"),
        ("none/t.usda", "found no folder"),
        ("t.ply", "found suffix '.ply'"),
    ):
        with pytest.raises((OutputError, UsageError, LookupError), match=said):
            build_tree(scan, tmp_path / target)
    assert (tmp_path / "t_chunks" / "mine.txt").read_text() == "x"
    build_tree(scan, tmp_path / "u.usda", options=SMALL)
    with pytest.raises(OutputError, match="which is being read"):
        build_tree(tmp_path / "u_chunks" / "0001.usdc", tmp_path / "u.usda")


def test_inputs_that_do_not_fit_are_one_sentence(scan, tmp_path):
    """Oracle: the sentences; nothing is left."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "ap1.usda"))
    schema.author(stage, "/a", ground(10), color_space="lin_ap1_scene")
    stage.GetRootLayer().Save()
    empty = Usd.Stage.CreateNew(str(tmp_path / "empty.usda"))
    empty.GetRootLayer().Save()
    target = tmp_path / "t.usda"
    with pytest.raises(UsageError, match="colours in lin_ap1_scene, expected srgb_rec709_scene"):
        build_tree([scan, tmp_path / "ap1.usda"], target)
    with pytest.raises(StageError, match="no splat field"):
        build_tree([scan, tmp_path / "empty.usda"], target)
    wrong = {"leaf_splats": 9, "sh_degree": 5, "pixel": -1.0, "memory_limit": 1}
    for name, value in (wrong | {"meters_per_unit": math.inf}).items():
        with pytest.raises(UsageError, match=name):
            build_tree(scan, target, options=LodOptions(**{name: value}))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "ap1.usda",
        "empty.usda",
        "scan.ply",
    ]


def test_an_unpacked_capture_continues(tmp_path):
    """Oracle: the bytes, the hash of all its files included, of an uninterrupted building."""
    (tmp_path / "sog").mkdir()
    formats.write(ground(600), tmp_path / "sog" / "meta.json")
    for source in (tmp_path / "sog", tmp_path / "sog" / "meta.json"):
        build_tree(source, tmp_path / "t.usda", options=SMALL)
        expected = tree_bytes(tmp_path / "t.usda")
        with pytest.raises(KeyboardInterrupt):
            build_tree(source, tmp_path / "t.usda", options=SMALL, progress=Stop(6))
        assert build_tree(source, tmp_path / "t.usda", options=SMALL).continued
        assert tree_bytes(tmp_path / "t.usda") == expected
