"""A solver that is a function of its own state, and stages for its bakes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core import quaternion
from usdsplat.core.cloud import SplatCloud
from usdsplat.sim.parameters import BakeParameters
from usdsplat.sim.stage.bake import Bake
from usdsplat.sim.stage.plan import ARRAYS, BakedField
from usdsplat.sim.stage.provenance import Provenance, input_hash, parameter_hash, parameter_lines
from usdsplat.sim.state import Frame, State

PATH = "/World/Splats"
ALL = frozenset(ARRAYS)


def save_stage(folder: Path, clouds: Mapping[str, SplatCloud], form: str = "float") -> Usd.Stage:
    """A stage with a file and fields in it."""
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(24)
    for path, each in clouds.items():
        schema.author(stage, path, each, form=form)
    stage.SetDefaultPrim(stage.DefinePrim("/World", "Xform"))
    stage.Save()
    return stage


@dataclass
class Solver:
    """Turns, drifts, grows; every third frame splats are born, every fifth one dies."""

    state: State
    lives: bool = True
    spin: float = 0.1
    """[radian] a frame."""
    moving: slice = field(default_factory=lambda: slice(None))
    """Which splats."""

    @classmethod
    def of(cls, rest: SplatCloud, **options: object) -> Solver:
        state = State.of(rest)
        state.memory["fake:age"] = np.zeros(len(rest), np.int16)
        state.globals["fake:sum"] = np.array(0.0)
        return cls(state, **options)

    def step(self) -> None:
        """To the next frame."""
        s, rows = self.state, self.moving
        s.step += 1
        if self.lives and s.step % 3 == 0:
            self._bear()
        if self.lives and s.step % 5 == 0:
            self._kill()
        phase = (s.ids * 0.7 + s.step).astype(np.float32)
        drift = np.stack([np.sin(phase), np.cos(phase), np.sin(2 * phase)], axis=1)
        s.velocities = s.velocities.copy()
        s.velocities[rows] = s.velocities[rows] * np.float32(0.9) + drift[rows]
        s.positions = s.positions.copy()
        s.positions[rows] += s.velocities[rows] / np.float32(24)
        turn = np.array([np.cos(self.spin / 2), 0, np.sin(self.spin / 2), 0], np.float32)
        s.rotations = s.rotations.copy()
        s.rotations[rows] = quaternion.normalize(quaternion.multiply(turn, s.rotations[rows]))
        s.scales = s.scales * np.float32(1.01)
        s.opacities = (s.opacities * np.float32(0.98)).astype(np.float32)
        s.sh = (s.sh * np.float32(0.999)).astype(np.float32)
        s.memory["fake:age"] = s.memory["fake:age"] + np.int16(1)
        s.globals["fake:sum"] = s.globals["fake:sum"] + np.float64(s.positions.sum())

    def frame(self, time: float) -> Frame:
        """What is handed over; the arrays are never written again."""
        s = self.state
        return Frame(time=time, cloud=s.cloud(), uv=s.uv, births=s.births)

    def _bear(self) -> None:
        """Two children, beside the first splats."""
        s, count = self.state, 2
        arrays = {name: np.concatenate([array, array[:count]]) for name, array in s.per_splat()}
        arrays["ids"][-count:] = s.next_id + np.arange(count)
        arrays["parents"][-count:] = s.ids[:count]
        arrays["positions"][-count:] += np.float32(0.25)
        s.next_id += count
        s.replace_rows(arrays)

    def _kill(self) -> None:
        """One in the middle."""
        s = self.state
        keep = np.arange(len(s)) != len(s) // 2
        s.replace_rows({name: array[keep] for name, array in s.per_splat()})


@dataclass
class Shot:
    """Everything a bake is opened with, and what came of the solver."""

    stage: Usd.Stage
    target: Path
    parameters: BakeParameters
    times: Sequence[float]
    solvers: Callable[[], dict[str, Solver]]
    writes: frozenset[str] = ALL
    seed: int = 0
    features: tuple[str, ...] = ()
    keeps: bool = True
    frames: dict[str, list[Frame]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)

    def provenance(self) -> Provenance:
        return Provenance(
            param_hash=parameter_hash(self.stage, self.times),
            parameters=parameter_lines(self.stage, self.times),
            input_hash=input_hash(self.stage, [self.stage.GetSessionLayer().identifier]),
            seed=self.seed,
            substeps=1,
            dt=1 / 24,
            frame_range=(self.times[0], self.times[-1]),
            mode=self.parameters.mode,
            threads=1,
            features=self.features,
        )

    def open(self, *, resume: bool = False) -> Bake:
        fields = [
            BakedField(
                path=path,
                rest=schema.fetch(self.stage.GetPrimAtPath(path)),
                writes=self.writes,
                is_fixed=not solver.lives,
            )
            for path, solver in self.solvers().items()
        ]
        return Bake.open(
            self.stage, self.target, fields, self.times, self.parameters, self.provenance(),
            resume=resume, keeps_checkpoint=self.keeps,
        )  # fmt: skip

    def run(
        self, *, resume: bool = False, stop: Callable[[str], None] = lambda event: None
    ) -> Path:
        """Simulate and bake; `stop` may raise at any event."""
        solvers = self.solvers()
        with self.open(resume=resume) as bake:
            if bake.resumed is not None:
                for path, state in bake.resumed.states.items():
                    solvers[path].state = state
            for time in bake.left:
                for path, solver in solvers.items():
                    if time != self.times[0]:
                        solver.step()
                    frame = solver.frame(time)
                    self.frames.setdefault(path, []).append(frame)
                    stop(f"before {time}")
                    bake.write(path, frame)
                    stop(f"after {time}")
                if bake.is_checkpoint_due(time):
                    bake.checkpoint(time, {path: each.state for path, each in solvers.items()})
                    stop(f"checkpoint {time}")
        self.digests = {path: each.state.digest() for path, each in solvers.items()}
        return self.target


def shot(
    folder: Path,
    mode: str = "dense",
    *,
    count: int = 14,
    lives: bool = True,
    form: str = "float",
    paths: Sequence[str] = (PATH,),
    writes: frozenset[str] = ALL,
    n: int = 12,
    spin: float = 0.1,
    stage: Usd.Stage | None = None,
    **knobs: object,
) -> Shot:
    """A shot of `count` frames from 1 on, of a stage or a new one."""
    if stage is None:
        clouds = {path: cloud(seed, n=n, degree=1) for seed, path in enumerate(paths)}
        stage = save_stage(folder, clouds, form)
    read = {path: schema.fetch(stage.GetPrimAtPath(path)) for path in paths}
    options = {"clip_frames": 4, "checkpoint_every": 3, **knobs}
    return Shot(
        stage=stage,
        target=folder / "bake.usda",
        parameters=BakeParameters(mode=mode, **options),
        times=[float(time) for time in range(1, count + 1)],
        solvers=lambda: {
            path: Solver.of(each, lives=lives, spin=spin) for path, each in read.items()
        },
        writes=writes,
    )


def everything(path: Path) -> dict[str, object]:
    """All that a stage says: each attribute's value at each of its samples, and by default."""
    stage = Usd.Stage.Open(str(path))
    found: dict[str, object] = {}
    for prim in stage.TraverseAll():
        found[f"{prim.GetPath()}"] = (prim.GetTypeName(), repr(prim.GetCustomData()))
        for attribute in prim.GetAttributes():
            for time in (Usd.TimeCode.Default(), *map(Usd.TimeCode, attribute.GetTimeSamples())):
                found[f"{attribute.GetPath()} {time}"] = _bits(attribute.Get(time))
    return found


def _bits(value: object) -> object:
    if hasattr(value, "__len__") and not isinstance(value, str | Gf.Vec3f):
        array = np.asarray(value)
        return array.dtype.str, array.shape, array.tobytes()
    return repr(value)


def layer_of(path: Path) -> Sdf.Layer:
    """A fresh reading of a file."""
    return Sdf.Layer.OpenAsAnonymous(str(path))
