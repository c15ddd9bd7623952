"""What crosses from the stage to the solver: plain values, arrays in the simulation's space.

The simulation's space is the field's own (`sim:space` local) or the stage's as the field saw it at
the first frame (world). Matrices are for column vectors, float64, shape (4, 4), and map to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from usdsplat.core.cloud import F32, F64, I32, SplatCloud
from usdsplat.sim.parameters import (
    AffectorParameters,
    DeformParameters,
    DriverParameters,
    Parameters,
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Surface:
    """Triangles at one time."""

    points: F32
    """[unit], shape (p, 3)."""
    triangles: I32
    """Rows of `points`, counter-clockwise from outside, shape (t, 3)."""


SolidKind = Literal["sphere", "capsule", "box", "plane", "mesh"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solid:
    """One body of an affector at one time."""

    kind: SolidKind
    matrix: F64
    """Of the body's own frame: turned and moved, its uniform scale already in the sizes. For a mesh
    that is deformed the identity."""
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[unit] sphere: (radius, -, -), about the origin; capsule: (radius at -z, radius at +z, half
    of the distance between their centres), along z; box: half of its edges; plane: -, all z < 0 is
    inside; mesh: -."""
    surface: Surface | None = None
    """Of a mesh, in its own frame."""
    is_rigid: bool = True
    """Whether only `matrix` changes over time."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Affector:
    """A prim with SplatAffectorAPI at one time."""

    path: str
    parameters: AffectorParameters
    solids: tuple[Solid, ...]
    """As many, of the same kinds, at every time."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Deformer:
    """An instance of SplatDeformerAPI at one time."""

    name: str
    parameters: DeformParameters
    frame: F64
    """Its space to the simulation's."""
    mask: F32 | None = None
    """The primvar it is multiplied by, shape (n,)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Driver:
    """An instance of SplatDriverAPI at one time."""

    name: str
    parameters: DriverParameters


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SkinBinding:
    """What binds splats to joints; the same at all times."""

    indices: I32 | None
    """Joints that the capture's splats follow, shape (n, k); None where `surface` binds them."""
    weights: F32 | None
    """How much, rows sum to 1, shape (n, k)."""
    bind: F64
    """`skel:geomBindTransform` in the simulation's space, shape (4, 4)."""
    surface: Surface | None = None
    """Mesh at bind time, in the simulation's space, from which splats take theirs."""
    surface_indices: I32 | None = None
    """Joints of its points, shape (p, k)."""
    surface_weights: F32 | None = None
    """Shape (p, k)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SkinPose:
    """The skeleton at one time."""

    joints: F64
    """Where each joint takes what it was bound to, in the simulation's space, shape (j, 4, 4)."""
    surface: Surface | None = None
    """The binding's mesh as it is now, for binding by triangles."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Moment:
    """All that the stage says at one time."""

    time: float
    """[time code]."""
    parameters: Parameters
    to_world: F64
    """The simulation's space to the stage's."""
    affectors: tuple[Affector, ...] = ()
    """Ordered by path; the same ones at every time."""
    target: Surface | None = None
    """What splats conform to."""
    relax_surface: Surface | None = None
    """What redistribution keeps splats on."""
    deformers: tuple[Deformer, ...] = ()
    """In the order of the stack."""
    drivers: tuple[Driver, ...] = ()
    """Ordered by name."""
    skin: SkinPose | None = None


class Recipe(Protocol):
    """One field and all that acts on it; a stage is read through it, and tests write their own."""

    @property
    def path(self) -> str:
        """Of the field."""

    @property
    def rest(self) -> SplatCloud:
        """The capture, in the simulation's space. Arrays may be read-only."""

    @property
    def selection(self) -> F32 | None:
        """`primvars:splatSim:weight`, shape (n,), 0 to 1; None where all are selected."""

    @property
    def binding(self) -> SkinBinding | None:
        """What binds the field to a skeleton."""

    @property
    def codes_per_second(self) -> float:
        """Time codes in a second."""

    def at(self, time: float) -> Moment:
        """What is so at a time code, whole or not."""
