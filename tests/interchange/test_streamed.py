"""Tests of streamed SOG that are opened as splat trees."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from pxr import Usd

from tests.delegate.stages import add_camera
from tests.formats.hostile import bombs
from tests.formats.samples import random_cloud
from tests.slowness import slowness
from usdsplat import formats, schema
from usdsplat.core.edit import merge, take, with_sh_degree
from usdsplat.core.errors import FormatError, UsdSplatError
from usdsplat.core.extent import extent
from usdsplat.core.node_cuts import level_cut
from usdsplat.core.node_table import NESTED
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate import trees
from usdsplat.interchange.lod.levels import typical_size
from usdsplat.interchange.opening import open_capture
from usdsplat.interchange.streamed import StreamedSog
from usdsplat.interchange.streamed_table import ERROR
from usdsplat.interchange.tree_reading import TreeChoice, tree_reading
from usdsplat.render.settings import RenderSettings
from usdsplat.schema.validation.trees import check_tree

FIELDS = ("positions", "scales", "rotations", "opacities", "sh")


def leaf(cloud, **lods):
    """A leaf whose box is that of splat-transform: around ellipsoids of one standard deviation."""
    low, high = cloud.positions.min(axis=0), cloud.positions.max(axis=0)
    size = cloud.scales.max(axis=0).max()
    bound = {"min": (low - size).tolist(), "max": (high + size).tolist()}
    names = ("file", "offset", "count")
    lods = {k[1:]: dict(zip(names, v, strict=True)) for k, v in lods.items()}
    return {"bound": bound, "lods": lods}


def scene(folder, *, far=False, **changes):
    """Three levels and two files: a leaf with the levels 0 and 2, one with 1 and 2, one with 0.

    Level 0 has 30 and 10 splats, level 1 has 12, level 2 has 8 and 4; the second file has no
    harmonics, the first has degree 2.
    """
    fine, coarse = random_cloud(40, 2, seed=1), random_cloud(24, 0, seed=2)
    formats.write(fine, folder / "fine.sog")
    formats.write(coarse, folder / "coarse.sog")
    everything = merge([with_sh_degree(coarse, 2), fine])
    below = {"children": [leaf(everything, l1=(1, 12, 12), l2=(1, 8, 4))]}
    meta = {
        "version": 1,
        "lodLevels": 3,
        "counts": [40, 12, 12],
        "filenames": ["fine.sog", "coarse.sog"],
        "tree": {
            "children": [
                leaf(everything, l0=(0, 0, 30), l2=(1, 0, 8)),
                below,
                leaf(everything, l0=(0, 30, 10)),
            ]
        },
    }
    if far:
        formats.write(random_cloud(9, 1, seed=3), folder / "far.sog")
        meta["environment"] = "far.sog"
    (folder / "lod-meta.json").write_text(json.dumps(meta | changes))
    return folder / "lod-meta.json"


def tree_of(path):
    """The prim of the tree."""
    stage = open_capture(path)
    (prim,) = (each for each in stage.Traverse() if schema.is_tree(each))
    return stage, prim


def rows(path, first, count, degree=2):
    """Splats of a file, read alone."""
    cloud = take(formats.read(path).cloud, np.arange(first, first + count))
    return with_sh_degree(cloud, degree)


def assert_same(found, expected):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


def test_levels_are_cuts_of_the_tree(tmp_path):
    """Oracle: the files read alone; a leaf without a finest level ends in no splats."""
    path = scene(tmp_path)
    stage, prim = tree_of(path)
    fine, coarse = tmp_path / "fine.sog", tmp_path / "coarse.sog"
    assert_same(tree_reading(prim).cloud(), rows(fine, 0, 40))
    found = tree_reading(prim, TreeChoice(level=9)).cloud()
    assert_same(found, merge([rows(fine, 30, 10), rows(coarse, 0, 12)]))
    middle = tree_reading(prim, TreeChoice(level=1)).cloud()
    parts = [rows(fine, 30, 10), rows(coarse, 0, 8), rows(coarse, 12, 12)]
    assert_same(middle, merge(parts))
    assert check_tree(prim) == []
    assert stage.GetDefaultPrim().GetPath() == prim.GetPath().GetParentPath()


def test_the_environment_is_in_every_cut(tmp_path):
    """Oracle: its file read alone."""
    stage, prim = tree_of(scene(tmp_path, far=True))
    far = rows(tmp_path / "far.sog", 0, 9)
    for level in (0, 9):
        found = tree_reading(prim, TreeChoice(level=level)).cloud()
        present = (found.positions[:, None] == far.positions).all(axis=2)
        assert present.any(axis=0).all()
    assert len(tree_reading(prim)) == 49
    assert stage.GetPrimAtPath(prim.GetPath())


def test_a_real_capture_has_the_levels_of_its_files(data):
    """Oracle: the reader of whole levels; coarse ones, which are small."""
    path = data / "streamed" / "playbot" / "lod-meta.json"
    stage, prim = tree_of(path)
    for level in (4, 5, 6):
        expected = formats.read(path, how=formats.ReadOptions(lod=level)).cloud
        assert_same(tree_reading(prim, TreeChoice(level=level)).cloud(), expected)
    table = tree_reading(prim).tree.table
    assert level_cut(table, 0).splats(table) == 500_000
    assert stage.GetRootLayer().anonymous


def test_boxes_contain_the_splats_and_errors_grow(data):
    """Oracle: `core.extent` of the decoded splats, and the definition of the typical size."""
    streamed = StreamedSog.open(data / "streamed" / "playbot")
    table = streamed.table
    for node in np.flatnonzero((table.chunk >= 0) & (table.proxies < 20_000)):
        path = streamed.chunks[table.chunk[node]]
        cloud = rows(path, table.first_row[node], table.proxies[node])
        low, high = extent(cloud)
        assert (low >= table.low[node]).all() and (high <= table.high[node]).all()
        if table.child_count[node]:
            below = NESTED * table.errors[table.first_child[node]]
            expected = max(ERROR * typical_size(cloud), below)
            assert table.errors[node] == pytest.approx(expected, rel=1e-3)
    assert np.isinf(table.errors[0])


def test_a_picture_of_the_leaves_is_that_of_the_finest_level(tmp_path):
    """Oracle: the same splats as a field at the same place, bit for bit."""
    path = scene(tmp_path)
    stage, prim = tree_of(path)
    expected = Usd.Stage.CreateInMemory()
    expected.GetRootLayer().TransferContent(stage.GetRootLayer())
    expected.RemovePrim(prim.GetPath())
    schema.author(expected, prim.GetPath(), formats.read(path).cloud)
    ops = expected.GetPrimAtPath(prim.GetPath())
    for name in ("xformOpOrder", *prim.GetAttribute("xformOpOrder").Get()):
        old = prim.GetAttribute(name)
        ops.CreateAttribute(name, old.GetTypeName(), False, old.GetVariability()).Set(old.Get())
    pictures = []
    for each in (stage, expected):
        add_camera(each)
        with Engine(each, device="cpu") as engine:
            view = engine.view("/Camera", resolution=(64, 48))
            pictures.append(engine.picture(view, RenderSettings(lod_error=0.0))["color"].copy())
    assert pictures[0][..., 3].max() > 0.5
    np.testing.assert_array_equal(*pictures)


def test_an_image_of_a_chunk_that_changes_is_noticed(tmp_path, monkeypatch):
    """Oracle: the picture of a new engine; `meta.json` of the folder stays as it is."""
    monkeypatch.setattr(trees, "POLL", 0.0)
    names = ["fine/meta.json", "coarse.sog"]
    path = scene(tmp_path, filenames=names)
    for number, name in enumerate(("fine", "other"), 1):
        (tmp_path / name).mkdir()
        formats.write(random_cloud(40, 2, seed=number), tmp_path / name / "meta.json")
    stage, _ = tree_of(path)
    add_camera(stage)
    settings = RenderSettings(lod_error=0.0)
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(64, 48))
        before = engine.picture(view, settings)["color"].copy()
        shutil.copy(tmp_path / "other" / "sh0.webp", tmp_path / "fine" / "sh0.webp")
        after = engine.picture(view, settings)["color"].copy()
    assert (after != before).any()
    with Engine(stage, device="cpu") as engine:
        np.testing.assert_array_equal(engine.picture(view, settings)["color"], after)


def test_a_stage_can_refer_to_the_files(tmp_path):
    """Oracle: the splats of the file, read through a layer that was saved and opened again."""
    path = scene(tmp_path)
    stage, prim = tree_of(path)
    stage.GetRootLayer().Export(str(tmp_path / "saved.usda"))
    again = Usd.Stage.Open(str(tmp_path / "saved.usda"))
    reading = tree_reading(again.GetPrimAtPath(prim.GetPath()))
    assert_same(reading.cloud(), formats.read(path).cloud)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"filenames": ["none.sog", "coarse.sog"]}, "no file 'none.sog'"),
        ({"environment": "fine.sog"}, "environment: found fine.sog, expected a file of its own"),
        (
            {"tree": {"lods": {"0": {"file": 0, "offset": 0, "count": 41}}}, "counts": [41, 0, 0]},
            "splat 40 of fine.sog, expected one of its 40",
        ),
        ({"tree": {}, "counts": [0, 0, 0]}, "no splats"),
        (
            {
                "tree": {
                    "bound": {"min": [1, 0, 0], "max": [0, 0, 0]},
                    "lods": {"0": {"file": 0, "offset": 0, "count": 4}},
                }
            },
            "a minimum that is not above the maximum",
        ),
    ],
)
def test_trees_that_lie_are_refused(tmp_path, changes, message):
    """Oracle: what is wrong with them."""
    with pytest.raises(FormatError, match=message):
        open_capture(scene(tmp_path, **changes))


def test_levels_that_share_splats_are_refused(tmp_path):
    """Oracle: a chunk's rows have one owner, in one leaf or in two."""
    lods = {str(k): {"file": 0, "offset": 0, "count": 4} for k in (0, 1)}
    with pytest.raises(FormatError, match=r"tree: found splat 0 of fine\.sog twice"):
        open_capture(scene(tmp_path, tree={"lods": lods}, counts=[4, 4, 0]))
    leaves = [{"lods": {str(k): {"file": 0, "offset": 3 - k, "count": 4}}} for k in (0, 1)]
    with pytest.raises(FormatError, match=r"tree: found splat 3 of fine\.sog twice"):
        open_capture(scene(tmp_path, tree={"children": leaves}, counts=[4, 4, 0]))


def test_a_deep_tree_is_refused(tmp_path):
    """Oracle: the limit of levels of a splat tree."""
    node = {"lods": {"0": {"file": 0, "offset": 0, "count": 4}}}
    for _ in range(64):
        node = {"children": [node]}
    with pytest.raises(FormatError, match="found more than 64 levels of nodes"):
        open_capture(scene(tmp_path, tree=node, counts=[4, 0, 0]))
    deepest = node["children"][0]  # its levels of detail are one more level of nodes
    chain = deepest
    while "lods" not in chain:
        (chain,) = chain["children"]
    chain["lods"]["1"] = {"file": 1, "offset": 0, "count": 4}
    with pytest.raises(FormatError, match="65 levels, expected at most 64"):
        open_capture(scene(tmp_path, tree=deepest, counts=[4, 4, 0]))


def test_bombs_are_refused_at_once(tmp_path):
    """Oracle: one sentence, in less than two seconds of a usual machine."""
    paths = [each for each in bombs(tmp_path) if each.name.startswith("lod_")]
    assert len(paths) >= 3
    for path in paths:
        start = time.process_time()
        with pytest.raises(UsdSplatError) as caught:
            open_capture(path)
        assert len(str(caught.value).splitlines()) == 1
        assert time.process_time() - start < 2 * slowness()


def test_opening_a_stage_does_not_load_what_builds_trees():
    """Oracle: the modules of a new process; Numba takes seconds to load."""
    code = "import sys, usdsplat.interchange.opening; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
