"""Tests of documents of stages and captures, and of files that change."""

from __future__ import annotations

import os
import time

import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.delegate.stages import random_cloud
from tests.preview.stage_model.stages import rich
from tests.sim.stage.scenes import save_shot
from usdsplat import formats, schema
from usdsplat.core.errors import FormatError, StageError, UsageError, UsdSplatError
from usdsplat.preview.opening import StageLoading, changed_files, document_of, open_document, reload
from usdsplat.preview.values import Busy, Problem, StageChanged, ViewState


@pytest.fixture
def shot(tmp_path):
    """Two files, the stronger one with a radius of 3."""
    made = rich()
    made.GetRootLayer().Export(str(tmp_path / "weak.usda"))
    root = Sdf.Layer.CreateNew(str(tmp_path / "shot.usda"))
    root.subLayerPaths = ["./weak.usda", "./missing.usda"]
    Sdf.CreatePrimInLayer(root, "/World/Ball")
    Sdf.AttributeSpec(root.GetPrimAtPath("/World/Ball"), "radius", Sdf.ValueTypeNames.Double)
    root.GetAttributeAtPath("/World/Ball.radius").default = 3.0
    root.Save()
    return tmp_path / "shot.usda"


@pytest.fixture
def capture(tmp_path):
    formats.write(random_cloud(1, n=10), tmp_path / "scan.ply")
    return tmp_path / "scan.ply"


@pytest.fixture
def opened():
    """Opens documents, with what they publish, and closes them."""
    documents = []

    def open_one(path, **options):
        events = []
        document = open_document(path, publish=events.append, threads=1, **options)
        documents.append(document)
        return document, events

    yield open_one
    for document in documents:
        document.close()


def write(path, text):
    """As another program saves: a new file in the place of the old one, later by the clock."""
    fresh = path.with_name(f"{path.name}.new")
    fresh.write_bytes(text if isinstance(text, bytes) else text.encode())
    os.replace(fresh, path)
    later = time.time_ns() + 10_000_000_000
    os.utime(path, ns=(later, later))


def radius(document):
    return document.stage.GetAttributeAtPath("/World/Ball.radius").Get()


def splats(document):
    return [len(schema.fetch(prim)) for prim in document.stage.Traverse()
            if schema.is_splat_field(prim)]  # fmt: skip


def test_a_stage_is_opened_and_its_files_are_only_read(opened, shot):
    """Oracle: the bytes of the files; what is missing is told in a sentence."""
    before = shot.read_bytes()
    document, events = opened(shot)
    document.edits.set_value("/World/Ball.radius", 9.0)
    assert radius(document) == 9.0
    assert shot.read_bytes() == before and not document.stage.GetRootLayer().dirty
    said = [event.sentence for event in events if isinstance(event, Problem)]
    assert len(said) == 1 and "missing.usda" in said[0]


def test_two_documents_of_one_file_share_no_edit(opened, shot):
    """Oracle: the other one's value."""
    first, _ = opened(shot)
    second, _ = opened(shot)
    first.edits.set_value("/World/Ball.radius", 9.0)
    assert (radius(first), radius(second)) == (9.0, 3.0)


def test_options_of_a_stage_hold_and_a_users_edits_are_stronger(opened, shot, tmp_path):
    """Oracle: the variant, the layer below a muted one, and the strength of a session layer."""
    given = Sdf.Layer.CreateNew(str(tmp_path / "given.usda"))
    spec = Sdf.AttributeSpec(
        Sdf.CreatePrimInLayer(given, "/World/Ball"), "radius", Sdf.ValueTypeNames.Double
    )
    spec.default = 5.0
    given.Save()
    document, _ = opened(
        shot,
        loading=StageLoading(
            variants=("/World/Part:season=autumn",),
            mask=("/World/Ball", "/World/Part"),
            session_layer=tmp_path / "given.usda",
        ),
    )
    part = document.stage.GetPrimAtPath("/World/Part")
    assert part.GetVariantSets().GetVariantSelection("season") == "autumn"
    assert not document.stage.GetPrimAtPath("/World/Cloud")
    assert radius(document) == 5.0
    document.edits.set_value("/World/Ball.radius", 6.0)
    assert radius(document) == 6.0
    muted, _ = opened(shot, loading=StageLoading(mute=("weak",)))
    assert not muted.stage.GetPrimAtPath("/World/Cloud")


def test_a_capture_becomes_a_stage_and_says_what_goes_on(opened, capture):
    """Oracle: the splats of the file, and the file's bytes."""
    before = capture.read_bytes()
    document, events = opened(capture)
    assert splats(document) == [10]
    said = [event.what for event in events if isinstance(event, Busy)]
    assert len(said) >= 2 and said[-1] == "" and "scan.ply" in said[0]
    assert capture.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "options", "error"),
    [
        ("scan.ply", {"loading": StageLoading(mute=("x",))}, UsageError),
        ("scan.ply", {"loading": StageLoading(variants=("/A:b=c",))}, UsageError),
        ("scan.ply", {"axes": "sideways"}, UsageError),
        ("shot.usda", {"axes": "rdf"}, UsageError),
        ("shot.usda", {"loading": StageLoading(mask=("/None",))}, StageError),
        ("shot.usda", {"loading": StageLoading(variants=("nonsense",))}, UsageError),
        ("none.usda", {}, StageError),
        ("none.ply", {}, FormatError),
        ("broken.ply", {}, FormatError),
        ("broken.usda", {}, StageError),
        ("folder", {}, UsdSplatError),
        ("shot.usda", {"device": "abacus"}, UsdSplatError),
    ],
)
def test_what_cannot_be_opened_is_a_sentence(shot, capture, tmp_path, name, options, error):
    """Oracle: the class of the error, and its shape; nobody is left busy."""
    (tmp_path / "broken.ply").write_bytes(capture.read_bytes()[:-9])
    (tmp_path / "broken.usda").write_text("#usda 1.0\ndef {")
    (tmp_path / "folder").mkdir()
    events = []
    with pytest.raises(error, match=r"found .+, expected .+"):
        open_document(tmp_path / name, publish=events.append, **options)
    busy = [event.what for event in events if isinstance(event, Busy)]
    assert not busy or busy[-1] == ""


def test_changed_files_are_told_and_read_again_beneath_the_edits(opened, shot):
    """Oracle: the values of the files as rewritten; the edit and its undo are still there."""
    document, events = opened(shot)
    document.edits.set_visible("/World/Cloud", False)
    assert changed_files(document) == ()
    write(shot, shot.read_text().replace("radius = 3", "radius = 4"))
    assert changed_files(document) == ("shot.usda",)
    assert radius(document) == 3.0
    assert reload(document) == ("shot.usda",)
    assert radius(document) == 4.0 and changed_files(document) == ()
    events.clear()
    document.draw(ViewState(size=(8, 6)))
    assert isinstance(next(each for each in events if not isinstance(each, Busy)), StageChanged)
    cloud = UsdGeom.Imageable(document.stage.GetPrimAtPath("/World/Cloud"))
    assert cloud.ComputeVisibility() == "invisible"
    assert document.edits.undo() == "Hide Cloud"
    assert cloud.ComputeVisibility() == "inherited"


def test_a_file_that_was_missing_is_found_on_reload(opened, shot, tmp_path):
    """Oracle: the prim that it holds."""
    document, _ = opened(shot)
    write(tmp_path / "missing.usda", '#usda 1.0\ndef Scope "Late" {\n}\n')
    reload(document)
    assert document.stage.GetPrimAtPath("/Late")


@pytest.mark.parametrize("broken", ["#usda 1.0\ndef {", "", None])
def test_a_file_that_cannot_be_read_again_leaves_everything(opened, shot, tmp_path, broken):
    """Oracle: the stage flattened, before and after; and that it works once mended."""
    document, _ = opened(shot)
    weak = tmp_path / "weak.usda"
    good = weak.read_text()
    before = document.stage.Flatten().ExportToString()
    write(shot, shot.read_text().replace("radius = 3", "radius = 4"))
    if broken is None:
        weak.unlink()
    else:
        write(weak, broken)
    assert changed_files(document) == ("shot.usda", "weak.usda")
    with pytest.raises(StageError, match=r"weak\.usda"):
        reload(document)
    assert document.stage.Flatten().ExportToString() == before
    write(weak, good)
    reload(document)
    assert radius(document) == 4.0


def test_a_capture_is_imported_anew_onto_the_same_stage(opened, capture):
    """Oracle: the new file's splats; the edit stays; an error leaves the old ones."""
    document, _ = opened(capture)
    stage = document.stage
    path = next(str(prim.GetPath()) for prim in stage.Traverse() if schema.is_splat_field(prim))
    document.edits.set_visible(path, False)
    whole = capture.read_bytes()
    write(capture, whole[:-20])
    assert changed_files(document) == ("scan.ply",)
    with pytest.raises(FormatError):
        reload(document)
    assert splats(document) == [10] and changed_files(document) == ("scan.ply",)
    formats.write(random_cloud(2, n=25), capture.with_name("next.ply"))
    write(capture, capture.with_name("next.ply").read_bytes())
    assert reload(document) == ("scan.ply",)
    assert document.stage is stage and splats(document) == [25]
    assert UsdGeom.Imageable(stage.GetPrimAtPath(path)).ComputeVisibility() == "invisible"
    assert reload(document) == ()


def test_a_layer_that_comes_into_use_later_is_watched_too(opened, shot, tmp_path):
    """Oracle: a reference that a user adds, whose file changes then."""
    document, _ = opened(shot)
    extra = tmp_path / "extra.usda"
    extra.write_text('#usda 1.0\n(\n    defaultPrim = "A"\n)\ndef Scope "A" {\n}\n')
    with Usd.EditContext(document.stage, document.stage.GetSessionLayer()):
        prim = document.stage.DefinePrim("/Extra")
        prim.GetReferences().AddReference(str(extra))
    assert changed_files(document) == ()
    write(extra, extra.read_text().replace("Scope", "Xform"))
    assert changed_files(document) == ("extra.usda",)
    reload(document)
    assert document.stage.GetPrimAtPath("/Extra").GetTypeName() == "Xform"


def test_a_document_can_simulate_what_is_on_its_stage(tmp_path, opened):
    """Oracle: a stage with a SplatSim prim, and one without."""
    document, _ = opened(save_shot(tmp_path, {}, count=5))
    assert document.simulation.status.state == "ready"
    stage = Usd.Stage.CreateInMemory()
    with_nothing = document_of(stage, threads=1)
    assert (with_nothing.stage, with_nothing.path) == (stage, None)
    assert with_nothing.simulation.status.state == "none"
    with_nothing.close()


def test_nothing_is_read_again_beneath_a_recording(tmp_path, opened):
    """Oracle: the sentence, while a recording is held; after a reset it is read."""
    document, _ = opened(save_shot(tmp_path, {}, count=5))
    with document.lock:  # so that it is held before it has begun
        document.simulation.record(tmp_path / "bake.usda", frames=[1.0, 2.0])
        document.simulation.pause()
    with pytest.raises(UsageError, match="being recorded"):
        reload(document)
    document.simulation.reset()
    assert reload(document) == ()


def test_what_frames_everything_frames_anew_after_a_reload(opened, capture):
    """Oracle: the capture is another; a document that is opened now frames it so."""
    document, _ = opened(capture)
    document.draw(ViewState(size=(40, 30)))
    before = document.shown.picture.camera
    formats.write(random_cloud(2, n=10), capture.with_name("next.ply"))
    write(capture, capture.with_name("next.ply").read_bytes())
    reload(document)
    document.draw(ViewState(size=(40, 30)))
    fresh, _ = opened(capture)
    fresh.draw(ViewState(size=(40, 30)))
    assert document.shown.picture.camera == fresh.shown.picture.camera != before
