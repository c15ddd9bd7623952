"""Tests that engines in one process are independent, and that a closed one releases everything."""

from __future__ import annotations

import gc
import threading
import tracemalloc
import weakref

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.delegate.stages import add_camera, random_cloud, two_fields
from usdsplat import schema
from usdsplat.delegate.engine import Engine

SIZE = (48, 36)
STEPS = 6


def shared_layer():
    """A layer with two animated fields and a camera, for several stages to share."""
    stage = two_fields()
    add_camera(stage)
    for time, x in ((1, 0.0), (6, 3.0)):
        stage.GetAttributeAtPath("/World/B.xformOp:translate").Set((x, 0, 0), time)
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(stage.GetRootLayer())
    return layer


class Shot:
    """One stage on a shared layer with a session layer, edits and times of its own."""

    def __init__(self, layer: Sdf.Layer, number: int) -> None:
        self.number = number
        self.stage = Usd.Stage.Open(layer, Sdf.Layer.CreateAnonymous(".usda"))
        self.stage.SetEditTarget(self.stage.GetSessionLayer())

    def edit(self, step: int) -> None:
        """Equal paths, other opinions in each shot."""
        rng = np.random.default_rng([self.number, step])
        prim = self.stage.GetPrimAtPath("/World/A")
        op = UsdGeom.Xformable(prim).MakeMatrixXform()
        op.Set(Gf.Matrix4d().SetTranslate(Gf.Vec3d(*rng.normal(size=3))))
        opacities = rng.uniform(0.2, 1.0, 12).astype(np.float32)
        prim.GetAttribute("opacities").Set(Vt.FloatArray.FromNumpy(opacities))
        UsdGeom.Imageable(prim).CreateVisibilityAttr("invisible" if step == 3 else "inherited")
        if step == 4:
            schema.author(self.stage, "/World/New", random_cloud(self.number))

    def render(self, engine: Engine, step: int) -> np.ndarray:
        """Edit, go to a time of its own, and draw."""
        self.edit(step)
        engine.set_time(1.0 + (step * (self.number + 1)) % 5)
        view = engine.view("/Camera", resolution=SIZE)
        return engine.picture(view, aovs=("color",))["color"]


def alone(number: int) -> list[np.ndarray]:
    """The pictures of a shot with nobody else around."""
    shot = Shot(shared_layer(), number)
    with Engine(shot.stage) as engine:
        return [shot.render(engine, step) for step in range(STEPS)]


def assert_equal_to_alone(pictures: dict[int, list[np.ndarray]]) -> None:
    for number, found in pictures.items():
        expected = alone(number)
        assert len({picture.tobytes() for picture in expected}) == STEPS
        for one, two in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, two)


def test_interleaved_engines_draw_what_each_draws_alone():
    """Oracle: each shot rendered with nobody else around; bit for bit."""
    layer = shared_layer()
    shots = [Shot(layer, number) for number in range(3)]
    engines = [Engine(shot.stage) for shot in shots]
    pictures = {shot.number: [] for shot in shots}
    for step in range(STEPS):
        for shot, engine in zip(shots, engines, strict=True):
            pictures[shot.number].append(shot.render(engine, step))
    for engine in engines:
        engine.close()
    assert_equal_to_alone(pictures)


def test_engines_in_two_threads_draw_what_each_draws_alone():
    """Oracle: each shot rendered with nobody else around; bit for bit."""
    layer = shared_layer()
    shots = [Shot(layer, number) for number in range(2)]
    pictures = {shot.number: [] for shot in shots}
    start = threading.Barrier(len(shots))

    def work(shot):
        with Engine(shot.stage, threads=1) as engine:
            start.wait()
            for step in range(STEPS):
                pictures[shot.number].append(shot.render(engine, step))

    threads = [threading.Thread(target=work, args=(shot,)) for shot in shots]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert_equal_to_alone(pictures)


def test_two_engines_of_one_stage_show_two_times():
    """Oracle: an engine that never knew another time."""
    layer = shared_layer()
    stage = Usd.Stage.Open(layer)
    with Engine(stage, time=1) as one, Engine(stage, time=4) as two:
        for time, engine in ((1, one), (4, two), (1, one)):
            view = engine.view("/Camera", resolution=SIZE)
            with Engine(stage, time=time) as fresh:
                expected = fresh.picture(view)["color"]
            np.testing.assert_array_equal(engine.picture(view)["color"], expected)


@pytest.mark.parametrize("close", [True, False], ids=["closed", "forgotten"])
def test_nothing_is_left_of_an_engine(close):
    """Oracle: weak references: to the engine, its scene and its arrays, without the garbage
    collector's help; a notice sent later reaches nobody."""
    stage = two_fields()
    gc.disable()
    try:
        engine = Engine(stage)
        engine.picture(engine.view(resolution=SIZE))
        scene = engine.render_scene
        cloud = next(iter(scene.drawn()))[1].spec.cloud.rotations
        left = [weakref.ref(each) for each in (engine, scene, cloud)]
        del scene, cloud
        if close:
            engine.close()
            assert left[2]() is None
        del engine
        assert [each() for each in left] == [None] * 3
    finally:
        gc.enable()
    stage.GetAttributeAtPath("/World/A.opacities").Clear()


def test_memory_comes_back_when_engines_close(any_device):
    """Oracle: tracemalloc, which counts NumPy's arrays, or the GPU's driver: eight engines with
    buffers of 3 MB each leave less behind than a tenth of one."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Big", random_cloud(n=20_000))
    add_camera(stage)
    held = resident_on_gpu if any_device == "cuda" else lambda: tracemalloc.get_traced_memory()[0]

    def work():
        with Engine(stage) as engine:
            engine.picture(engine.view("/Camera", resolution=(200, 150)))
            return resident_on_gpu() if any_device == "cuda" else 0

    work()
    tracemalloc.start()
    try:
        work()
        gc.collect()
        before = held()
        most = max(work() for _ in range(8))
        if any_device == "cpu":
            _, most = tracemalloc.get_traced_memory()
        gc.collect()
        after = held()
    finally:
        tracemalloc.stop()
    assert most - before > (0 if any_device == "cuda" else 3e6)
    assert after - before < 3e5


def resident_on_gpu() -> int:
    """What this process has allocated on the GPU [byte]; others may use it too."""
    from numba import cuda

    cuda.current_context().deallocations.clear()
    return sum(each.size for each in cuda.current_context().memory_manager.allocations.values())


def test_many_engines_need_no_more_memory_than_one(data):
    """Oracle: the process's resident set, which counts what tracemalloc cannot, over forty engines
    with a real capture."""
    from usdsplat import formats

    stage = Usd.Stage.CreateInMemory()
    capture = formats.read(data / "splats" / "flowers_lod3_0.sog")
    schema.author(stage, "/Capture", capture.cloud)

    def work():
        with Engine(stage) as engine:
            engine.picture(engine.view(resolution=(64, 48)))

    for _ in range(5):
        work()
    before = resident()
    for _ in range(40):
        work()
    assert resident() - before < 3 * capture.cloud.sh.nbytes + 10e6


def resident() -> int:
    """Resident set of this process [byte]."""
    gc.collect()
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096
