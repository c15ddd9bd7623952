"""Tests of meshes and lights, with a scene delegate and a render scene that record calls."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import Placement
from usdsplat.delegate.light import Light
from usdsplat.delegate.mesh import Mesh
from usdsplat.delegate.render_index import RenderIndex
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import MeshSpec


def triangle() -> MeshSpec:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    numbers = np.array([[0, 1, 2]], np.int32)
    return MeshSpec(points=points, triangles=numbers, faces=np.zeros(1, np.int32))


class Recorder:
    """A scene delegate for any path, and a render scene, that write down what is asked of them."""

    def __init__(self):
        self.asked = Counter()
        self.bits = DirtyBits.CLEAN
        self.edits = []
        self.spec = triangle()
        self.light_spec = LightSpec(direction=(0.0, 0.0, -1.0), irradiance=(1.0, 1.0, 1.0))
        self.seen = (True,)
        self.world = np.eye(4)

    def mesh(self, path, bits):
        self.asked["mesh"] += 1
        self.bits = bits
        return self.spec

    def light(self, path):
        self.asked["light"] += 1
        return self.light_spec

    def placements(self, path):
        self.asked["placements"] += 1
        return (Placement(path=path),)

    def transforms(self, path):
        self.asked["transforms"] += 1
        return ((self.world,),)

    def visible(self, path):
        self.asked["visible"] += 1
        return self.seen

    def __getattr__(self, name):
        return lambda *arguments: self.edits.append(name)


def synced():
    recorder = Recorder()
    mesh = Mesh("/a", {})
    mesh.sync(recorder, RenderParam(recorder), mesh.INITIAL_DIRTY_BITS)
    recorder.asked.clear()
    recorder.edits.clear()
    return recorder, RenderParam(recorder), mesh


def test_a_new_mesh_pulls_everything_once_and_enters_the_scene_before_it_is_placed():
    """Oracle: the render scene's contract: instances and visibility are of meshes it holds."""
    recorder = Recorder()
    mesh = Mesh("/a", {})
    left = mesh.sync(recorder, RenderParam(recorder), mesh.INITIAL_DIRTY_BITS)
    assert left == DirtyBits.CLEAN
    assert recorder.asked == Counter(mesh=1, placements=1, transforms=1, visible=1)
    assert recorder.edits == ["set_mesh", "set_instances", "set_visible"]
    assert recorder.bits == DirtyBits.SURFACE


@pytest.mark.parametrize(
    "bits", [DirtyBits.POINTS, DirtyBits.TOPOLOGY, DirtyBits.PRIMVAR | DirtyBits.MATERIAL_ID]
)
def test_a_mesh_says_which_of_its_arrays_it_needs(bits):
    """Oracle: the recorder's notes."""
    recorder, param, mesh = synced()
    assert mesh.sync(recorder, param, bits | DirtyBits.INSTANCER) == DirtyBits.CLEAN
    assert (recorder.asked, recorder.bits) == (Counter(mesh=1), bits)
    assert recorder.edits == ["set_mesh"]


def test_a_hidden_mesh_pulls_its_arrays_only_when_it_shows():
    """Oracle: the recorder's notes."""
    recorder = Recorder()
    recorder.seen = (False,)
    mesh = Mesh("/a", {})
    left = mesh.sync(recorder, RenderParam(recorder), mesh.INITIAL_DIRTY_BITS)
    assert left == DirtyBits.SURFACE
    assert recorder.asked["mesh"] == 0 and recorder.edits == []
    recorder.seen = (True,)
    mesh.sync(recorder, RenderParam(recorder), left | DirtyBits.VISIBILITY)
    assert recorder.edits == ["set_mesh", "set_instances", "set_visible"]


def test_a_mesh_that_cannot_be_drawn_leaves_the_scene_and_comes_back():
    """Oracle: the recorder's notes."""
    recorder, param, mesh = synced()
    recorder.spec = None
    mesh.sync(recorder, param, DirtyBits.POINTS)
    assert recorder.edits == ["remove"]
    recorder.edits.clear()
    recorder.spec = triangle()
    mesh.sync(recorder, param, DirtyBits.POINTS)
    assert recorder.edits == ["set_mesh", "set_instances", "set_visible"]


def test_a_light_edits_the_scene_when_it_is_another_and_goes_out_at_the_end():
    """Oracle: the recorder's notes; a version that stands still means no picture is redrawn."""
    recorder = Recorder()
    param, light = RenderParam(recorder), Light("/l")
    light.sync(recorder, param, light.INITIAL_DIRTY_BITS)
    light.sync(recorder, param, DirtyBits.TRANSFORM)
    light.sync(recorder, param, DirtyBits.RENDER_TAG)
    assert (recorder.asked, recorder.edits) == (Counter(light=2), ["set_light"])
    light.finalize(param)
    assert recorder.edits == ["set_light", "set_light"]


def test_an_index_that_closes_leaves_no_mesh_and_no_light():
    """Oracle: the emptied render scene."""
    scene = RenderScene()
    index = RenderIndex(RenderParam(scene))
    index.insert_mesh("/a")
    index.insert_light("/l")
    index.sync_all(Recorder())
    assert scene.paths == ("/a",) and len(scene.lights) == 1
    index.close()
    assert scene.paths == () and scene.lights == ()
