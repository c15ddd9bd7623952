"""Tests of commands that several processes take over."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Gf, Usd, UsdRender

from tests.products.test_tiles import content
from usdsplat.cli import sharing
from usdsplat.cli.bundles import on_a_farm
from usdsplat.cli.job_options import JobOptions
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.sharing import EFFICIENCY, LOADING, Capacity, Pace, may_share
from usdsplat.core.progress import silent

GIB = 1 << 30
HERE = Capacity(cores=8, free=64 * GIB, peak=GIB)


@pytest.mark.parametrize("serial", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("processes", [1, 2, 8])
def test_the_speedup_is_that_of_amdahl(serial, processes):
    """Oracle: Amdahl's law: work of time 1 of which a part runs on one core, in one process and in
    several that share 8 cores; pictures in a unit of time."""

    def time(cores):
        return serial + (1 - serial) / cores

    busy = 1 / (time(8) * 8)
    expected = processes / time(8 / processes) * time(8)
    assert HERE.speedup(processes, busy) == pytest.approx(max(1, EFFICIENCY * expected))


def test_processes_are_as_many_as_cores_gpus_memory_and_tasks_allow():
    """Oracle: by hand."""
    assert HERE.processes(100) == 8 and HERE.processes(3) == 3
    assert Capacity(cores=8, free=5 * GIB + 1, peak=2 * GIB).processes(100) == 2
    assert Capacity(cores=8, free=GIB, peak=2 * GIB).processes(100) == 1
    assert Capacity(cores=8, free=0, peak=GIB).processes(100) == 1  # nobody knows whether they fit
    assert Capacity(cores=8, free=GIB, peak=0).processes(100) == 1
    with_gpus = Capacity(cores=8, free=64 * GIB, peak=GIB, gpus=4)
    assert with_gpus.processes(100) == 4
    assert with_gpus.speedup(4, 0.1) == pytest.approx(4 * EFFICIENCY)
    assert with_gpus.speedup(4, 0.5) == pytest.approx(2 * EFFICIENCY)


class Work:
    """Work whose units take a time and keep a part of 8 cores busy."""

    def __init__(self, seconds, busy, here=HERE, total=100, **pace):
        self.now = self.cpu = self.compiled = 0.0
        self.seconds, self.busy, self.total = seconds, busy, total
        self.pace = Pace(
            silent, lambda: here, clock=lambda: self.now, cpu=lambda: self.cpu,
            compiled=lambda: self.compiled, **pace,
        )  # fmt: skip
        self.pace.step("rows", 0, total)
        self.done = 0

    def go_on(self, units, *, compiling=0.0):
        for _ in range(units):
            self.done += 1
            self.now += self.seconds + compiling
            self.cpu += self.seconds * self.busy * 8 + compiling
            self.compiled += compiling
            self.pace.step("rows", self.done, self.total)
            self.pace.step("something else", 0, 2)
            self.pace.step("rows", self.done, self.total)

    def processes(self):
        return self.pace.processes(self.total - self.done)


def test_work_is_shared_as_soon_as_that_saves_time():
    """Oracle: by hand: 98 units of 1 s that keep an eighth of the cores busy take 8 processes
    98 / (8 x 0.9) + start s; units that keep nearly all busy, or that take 10 s in all, are not
    shared, nor is what was measured for a moment only."""
    one = Work(1.0, 1 / 8, label="rows")
    one.go_on(1)
    assert one.processes() == 1  # the first one also prepares the others
    one.go_on(1)
    assert one.processes() == 1
    one.go_on(1)
    assert one.processes() == 8
    busy = Work(1.0, 0.95, label="rows")
    busy.go_on(20)
    assert busy.processes() == 1
    short = Work(0.1, 1 / 8, label="rows")
    short.go_on(60)
    assert short.processes() == 1
    alone = Work(1.0, 1 / 8, Capacity(cores=8, free=GIB, peak=GIB), label="rows")
    alone.go_on(20)
    assert alone.processes() == 1


def test_the_start_counts():
    """Oracle: by hand: the first unit took 60 s, so processes begin after 62 s; 100 s are left
    alone, which 8 processes would need 14 s for."""
    work = Work(60.0, 1 / 8, total=106, label="rows")
    work.go_on(1)
    work.seconds = 1.0
    work.go_on(5)
    assert work.processes() == 8  # 100 > 14 + 62, by more than a fifth
    work.go_on(14)
    assert work.processes() == 1  # 86 s against 12 + 62
    assert LOADING == 2.0


def test_compiling_kernels_is_no_measure():
    """Oracle: by hand: a kernel that is compiled for 30 s during the third unit keeps one core
    busy; the units before and after keep all."""
    work = Work(1.0, 1.0, label="rows")
    work.go_on(2)
    work.go_on(1, compiling=30.0)
    work.go_on(5)
    assert work.processes() == 1


def test_what_is_done_again_counts():
    """Oracle: by hand: after 60 of 100 units of 1 s, 8 processes that do all again take 100 / 7.2
    s, less than the 40 s that are left; after 80 units they take more than saves a fifth."""
    work = Work(1.0, 1 / 8, label="rows")
    work.go_on(60)
    assert work.pace.processes(100, again=True) == 8
    work.go_on(20)
    assert work.pace.processes(100, again=True) == 1


def test_limited_commands_and_workers_stay_alone(monkeypatch):
    """Oracle: by hand: --threads, --memory-limit and such limit one process; a worker of a job
    and a task of a farm share their machine with others."""
    reporter = Reporter(ReportingOptions())
    assert may_share(JobOptions(), reporter, None, None)
    assert not may_share(JobOptions(), reporter, None, 4)
    assert not may_share(JobOptions(jobs="1"), reporter)
    assert not may_share(JobOptions(), Reporter(ReportingOptions(strict=True)))
    assert not may_share(JobOptions(), Reporter(on_a_farm(ReportingOptions())))
    monkeypatch.setenv("USDSPLAT_JOB_WORKER", "1")
    assert not may_share(JobOptions(), reporter)


@pytest.fixture
def eager(monkeypatch):
    """A machine on which every command is shared as soon as it is measured."""
    monkeypatch.setattr(sharing, "MEASURED", 0.0)
    monkeypatch.setattr(sharing, "LEAST_SAVED", -1e9)
    monkeypatch.setattr(sharing, "LEAST_PART", -1e9)
    monkeypatch.setattr(sharing, "capacity", lambda device: Capacity(cores=2, free=GIB, peak=1))
    for module in ("render", "convert", "simulate"):
        monkeypatch.setattr(f"usdsplat.cli.{module}.capacity", sharing.capacity)


@pytest.mark.usefixtures("compiled")
def test_pictures_that_processes_take_over_are_those_of_one(run, run_json, shot, tmp_path, request):
    """Oracle: one process: pixels, headers but dates, and the report but for times; also with
    --resume, which keeps what is there."""
    words = ("render", shot, "--frames", "1-6", "--resolution", "64x40", "--device", "cpu", "-q")
    alone = run_json(*words, "-o", tmp_path / "alone" / "a.####.exr")
    request.getfixturevalue("eager")
    out = tmp_path / "shared" / "a.####.exr"
    status, _, err = run(*words[:-1], "-o", out)
    assert status == 0 and "2 processes go on" in err
    pictures = {each.name: content(each) for each in out.parent.iterdir()}
    assert pictures == {each.name: content(each) for each in (tmp_path / "alone").iterdir()}
    for frame in (1, 3, 4, 5):
        (out.parent / f"a.000{frame}.exr").unlink()
    report = run_json(*words, "-o", out, "--resume")
    assert [each["frame"] for each in report["pictures"]] == [1, 3, 4, 5]
    assert len(report["skipped"]) == 2
    times = {"seconds": 0, "path": ""}
    kept = [{**each, **times} for each in alone["pictures"] if each["frame"] not in (2, 6)]
    assert [{**each, **times} for each in report["pictures"]] == kept
    assert {each.name: content(each) for each in out.parent.iterdir()} == pictures


@pytest.mark.usefixtures("compiled", "eager")
@pytest.mark.parametrize("words", [(), ("--resume",)], ids=["all", "resume"])
def test_pictures_of_several_products_are_drawn_and_told_once(
    run, run_json, shot, tmp_path, monkeypatch, words
):
    """Oracle: by hand: frame by frame, each of three products once, also where one is there."""
    monkeypatch.chdir(tmp_path)
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateResolutionAttr(Gf.Vec2i(32, 20))
    settings.CreateCameraRel().SetTargets(["/World/Cam"])
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    for name in "abc":
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.CreateProductNameAttr(f"out/{name}.$F4.png")
        settings.CreateProductsRel().AddTarget(product.GetPath())
    stage.Save()
    render = ("render", shot, "--frames", "1-4", "--device", "cpu", *words)
    there = [(1, "c"), (3, "a")] if words else []
    for frame, name in there:
        one = ("--frames", f"{frame}", "--product", f"/Render/{name}", "--jobs", "1")
        assert run(*render[:2], *one, "--device", "cpu")[0] == 0
    expected = [(n, each) for n in range(1, 5) for each in "abc" if (n, each) not in there]
    report = run_json(*render, "-q")
    told = [(each["frame"], Path(each["path"]).name[0]) for each in report["pictures"]]
    assert told == expected
    if there:
        return
    status, out, err = run(*render)
    assert status == 0 and "2 processes go on" in err
    assert len(out.split()) == len(set(out.split())) == 12


@pytest.mark.usefixtures("compiled", "eager")
def test_a_conversion_that_processes_take_over(run, run_json, shot, tmp_path):
    """Oracle: one process, which --jobs 1 asks for: bytes, and the report but for the name."""
    words = ("convert", shot, "--frames", "1-6", "--prim", "/World/Ball")
    alone = run_json(*words, tmp_path / "alone" / "c.####.ply", "--jobs", "1")
    status, _, err = run(*words, tmp_path / "said" / "c.####.ply")
    assert status == 0 and "2 processes go on" in err
    made = run_json(*words, tmp_path / "shared" / "c.####.ply", "-q")
    files = {each.name: each.read_bytes() for each in (tmp_path / "shared").iterdir()}
    assert files == {each.name: each.read_bytes() for each in (tmp_path / "alone").iterdir()}
    assert {**made, "target": ""} == {**alone, "target": ""}


@pytest.mark.usefixtures("eager")
def test_a_wedge_that_processes_take_over(run, sim, tmp_path, monkeypatch):
    """Oracle: one process, bytes: its bakes have a thread each, too."""
    monkeypatch.setenv("USDSPLAT_THREADS", "1")
    words = ("simulate", sim, "--frames", "1:2", "--wedge", "settle:omega=0,10,20,40")
    status, out, err = run(*words, "-o", tmp_path / "alone" / "b.usda", "--force", "-q")
    assert (status, err) == (0, "")
    status, made, err = run(*words, "-o", tmp_path / "shared" / "b.usda")
    assert status == 0 and "2 processes go on" in err
    assert made == out.replace("/alone/", "/shared/") and len(made.splitlines()) == 5
    found = sorted(each for each in (tmp_path / "alone").rglob("*") if each.is_file())
    assert len(found) > 5
    for each in found:
        other = tmp_path / "shared" / each.relative_to(tmp_path / "alone")
        assert other.read_bytes() == each.read_bytes()
