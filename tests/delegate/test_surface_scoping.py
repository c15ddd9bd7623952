"""Tests that engines share nothing, even if their stages share surfaces."""

from __future__ import annotations

import gc
import threading
import weakref

from pxr import Gf, Sdf, Usd, Vt

from tests.delegate.surface_stages import (
    add_light,
    add_material,
    add_mesh,
    add_skinned,
    bind,
    colors,
    mesh_at,
    surfaces,
)
from usdsplat.delegate.engine import Engine


def shared_layer() -> Sdf.Layer:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    mesh = add_mesh(stage, "/M", scheme="catmullClark")
    bind(mesh, add_material(stage, "/Looks/Mat"))
    add_skinned(stage, "/Rig")
    add_light(stage)
    return layer


def stages_over(layer: Sdf.Layer) -> list[Usd.Stage]:
    """Two stages over one layer, which differ in their session layers."""
    made = []
    for tone in ((1, 0, 0), (0, 0, 1)):
        session = Sdf.Layer.CreateAnonymous(".usda")
        stage = Usd.Stage.Open(layer, session)
        stage.SetEditTarget(session)
        stage.GetAttributeAtPath("/Looks/Mat/Surface.inputs:diffuseColor").Set(Gf.Vec3f(*tone))
        made.append(stage)
    return made


def test_engines_on_stages_that_share_a_layer_see_their_own() -> None:
    """Oracle: each engine alone; then only one of two stages is edited."""
    one, two = stages_over(shared_layer())
    alone = []
    for stage, time in ((one, 1.0), (two, 3.0)):
        with Engine(stage, time=time) as engine:
            alone.append(surfaces(engine))
    with Engine(one, time=1.0) as first, Engine(two, time=3.0) as second:
        assert [surfaces(first), surfaces(second)] == alone
        assert mesh_at(first, "/M").materials[0].diffuse == (1, 0, 0)
        one.GetAttributeAtPath("/M.primvars:displayColor").Set(Vt.Vec3fArray(colors((1, 1, 1))))
        one.GetAttributeAtPath("/Looks/Mat/Surface.inputs:diffuseColor").Set(Gf.Vec3f(0, 1, 0))
        before = second.pulls
        assert surfaces(second) == alone[1] and second.pulls == before
        assert mesh_at(first, "/M").materials[0].diffuse == (0, 1, 0)


def test_two_threads_go_through_time_as_one_does() -> None:
    """Oracle: the same stage read by one engine alone, at each time."""
    layer = shared_layer()
    stages = [Usd.Stage.Open(layer) for _ in range(2)]
    times = [1.0, 2.0, 3.0, 1.5] * 3
    expected = []
    with Engine(stages[0]) as engine:
        for time in times:
            engine.set_time(time)
            expected.append([part[1:] for part in surfaces(engine)])
    found: dict[int, list[object]] = {}

    def work(number: int) -> None:
        with Engine(stages[number]) as engine:
            found[number] = []
            for time in times:
                engine.set_time(time)
                found[number].append([part[1:] for part in surfaces(engine)])

    threads = [threading.Thread(target=work, args=(number,)) for number in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == {0: expected, 1: expected}


def test_a_closed_engine_holds_no_mesh() -> None:
    """Oracle: the garbage collector."""
    layer = shared_layer()
    stage = Usd.Stage.Open(layer)
    engine = Engine(stage)
    spec = weakref.ref(engine.render_scene.drawn_meshes()[0][1].spec.points)
    engine.close()
    gc.collect()
    assert spec() is None
