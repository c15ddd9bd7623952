"""Tests of prims, with a scene delegate and a render scene that record calls."""

from __future__ import annotations

from collections import Counter

import numpy as np

from tests.delegate.stages import random_cloud
from usdsplat.delegate.camera import Camera
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancer import Instancer
from usdsplat.delegate.instancing import NO_INSTANCES, Placement
from usdsplat.delegate.render_index import RenderIndex
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.splat_field import SplatField
from usdsplat.render.specs import IDENTITY, CameraSpec, CropSpec, FieldSpec


class Recorder:
    """A scene delegate for any path, and a render scene, that write down what is asked of them."""

    def __init__(self):
        self.asked = Counter()
        self.edits = []
        self.spec = FieldSpec(cloud=random_cloud(n=3))
        self.seen = (True,)
        self.world = np.eye(4)
        self.volumes = ()

    def field(self, path):
        self.asked["field"] += 1
        return self.spec

    def crops(self, path):
        self.asked["crops"] += 1
        return self.volumes

    def placements(self, path):
        self.asked["placements"] += 1
        return (Placement(path=path),)

    def transforms(self, path):
        self.asked["transforms"] += 1
        return ((self.world,),)

    def visible(self, path):
        self.asked["visible"] += 1
        return self.seen

    def instancer(self, path):
        self.asked["instancer"] += 1
        return NO_INSTANCES

    def camera(self, path):
        self.asked["camera"] += 1
        return CameraSpec(path=path)

    def __getattr__(self, name):
        return lambda *arguments: self.edits.append(name)


def synced():
    recorder = Recorder()
    param = RenderParam(recorder)
    field = SplatField("/a", {})
    field.sync(recorder, param, field.INITIAL_DIRTY_BITS)
    recorder.asked.clear()
    recorder.edits.clear()
    return recorder, param, field


def test_a_new_field_pulls_everything_once_and_enters_the_scene_before_it_is_placed():
    """Oracle: the render scene's contract: instances and visibility are of fields it holds."""
    recorder = Recorder()
    field = SplatField("/a", {})
    left = field.sync(recorder, RenderParam(recorder), field.INITIAL_DIRTY_BITS)
    assert left == DirtyBits.CLEAN
    assert recorder.asked == Counter(field=1, placements=1, transforms=1, visible=1, crops=1)
    assert recorder.edits == ["set_field", "set_instances", "set_visible"]


def test_each_bit_pulls_its_own_and_nothing_else():
    """Oracle: the recorder's notes."""
    wanted = {
        DirtyBits.PRIMVAR: (Counter(field=1), ["set_field"]),
        DirtyBits.TRANSFORM: (Counter(transforms=1), ["set_instances"]),
        DirtyBits.VISIBILITY: (Counter(visible=1), ["set_visible"]),
        DirtyBits.RENDER_TAG: (Counter(visible=1), ["set_visible"]),
        DirtyBits.INSTANCE_INDEX: (Counter(placements=1), []),
        DirtyBits.CATEGORIES: (Counter(crops=1), ["set_crops"]),
        DirtyBits.INSTANCER: (Counter(), []),
        DirtyBits.CLEAN: (Counter(), []),
    }
    for bits, (asked, edits) in wanted.items():
        recorder, param, field = synced()
        recorder.world = 2 * np.eye(4)
        recorder.seen = (False,)
        recorder.volumes = (CropSpec(shape="sphere", world_to_shape=IDENTITY, keeps=True),)
        assert field.sync(recorder, param, bits) == DirtyBits.CLEAN
        assert (recorder.asked, recorder.edits) == (asked, edits), bits


def test_an_answer_that_did_not_change_edits_nothing_and_keeps_the_version():
    """Oracle: the recorder's notes; a version that stands still means no picture is redrawn."""
    recorder, param, field = synced()
    version = param.version
    bits = DirtyBits.TRANSFORM | DirtyBits.VISIBILITY | DirtyBits.CATEGORIES
    field.sync(recorder, param, bits)
    assert (recorder.edits, param.version) == ([], version)


def test_a_hidden_field_pulls_its_arrays_only_when_it_shows():
    """Oracle: the recorder's notes."""
    recorder = Recorder()
    recorder.seen = (False,)
    param = RenderParam(recorder)
    field = SplatField("/a", {})
    left = field.sync(recorder, param, field.INITIAL_DIRTY_BITS)
    assert left == DirtyBits.PRIMVAR
    assert recorder.asked["field"] == 0
    assert recorder.edits == []
    assert field.sorting_hint is None
    recorder.seen = (True,)
    assert field.sync(recorder, param, left | DirtyBits.VISIBILITY) == DirtyBits.CLEAN
    assert recorder.asked["field"] == 1
    assert field.sorting_hint == "zDepth"


def test_a_field_that_cannot_be_drawn_leaves_the_scene_and_comes_back_when_mended():
    """Oracle: the recorder's notes."""
    recorder, param, field = synced()
    spec, recorder.spec = recorder.spec, None
    field.sync(recorder, param, DirtyBits.PRIMVAR)
    assert recorder.edits == ["remove"]
    field.sync(recorder, param, DirtyBits.TRANSFORM)
    assert recorder.edits == ["remove"]
    recorder.spec = spec
    field.sync(recorder, param, DirtyBits.PRIMVAR)
    assert recorder.edits == ["remove", "set_field", "set_instances", "set_visible"]


def test_a_field_that_comes_back_is_cropped_as_before():
    """Oracle: the recorder's notes; a new field of the render scene has no crops."""
    recorder, param, field = synced()
    recorder.volumes = (CropSpec(shape="sphere", world_to_shape=IDENTITY, keeps=True),)
    field.sync(recorder, param, DirtyBits.CATEGORIES)
    spec, recorder.spec = recorder.spec, None
    field.sync(recorder, param, DirtyBits.PRIMVAR)
    recorder.spec = spec
    recorder.edits.clear()
    field.sync(recorder, param, DirtyBits.PRIMVAR)
    assert recorder.edits == ["set_field", "set_instances", "set_crops", "set_visible"]


def test_finalize_takes_back_what_sync_put_there_and_no_more():
    """Oracle: the recorder's notes."""
    recorder, param, field = synced()
    field.finalize(param)
    field.finalize(param)
    assert recorder.edits == ["remove"]


def test_instancers_and_cameras_pull_when_dirty_and_edit_nothing():
    """Oracle: the recorder's notes."""
    recorder = Recorder()
    param = RenderParam(recorder)
    for prim in (Instancer("/i"), Camera("/c")):
        prim.sync(recorder, param, prim.INITIAL_DIRTY_BITS)
        prim.sync(recorder, param, DirtyBits.VISIBILITY)
        prim.finalize(param)
    assert recorder.asked == Counter(instancer=1, camera=1)
    assert recorder.edits == []


def test_a_clean_index_asks_for_nothing():
    """Oracle: the recorder's notes."""
    recorder = Recorder()
    index = RenderIndex(RenderParam(recorder))
    index.insert_field("/a")
    index.insert_instancer("/i")
    index.insert_camera("/c")
    index.sync_all(recorder)
    assert recorder.asked == Counter(
        field=1, placements=1, transforms=1, visible=1, crops=1, instancer=1, camera=1
    )
    recorder.asked.clear()
    index.sync_all(recorder)
    assert not recorder.asked
    index.close()
    assert recorder.edits[-1] == "remove"
    assert not index.fields and not index.instancers and not index.cameras
