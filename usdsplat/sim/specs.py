"""Values that pass from the stage to the solver; arrays are in the simulation's space.

The simulation's space is the field's own (`sim:space` local), or the stage's as seen from the field
at the first frame (world). Matrices are for column vectors, float64, shape (4, 4), and map to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from usdsplat.core.cloud import F32, F64, I32, SplatCloud
from usdsplat.sim.parameters import (
    AffectorParameters,
    DeformParameters,
    DriverParameters,
    MaskParameters,
    Parameters,
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Surface:
    """Triangles at one time."""

    points: F32
    """Positions [unit], shape (p, 3)."""
    triangles: I32
    """Rows of `points`, counter-clockwise from outside, shape (t, 3)."""


SolidKind = Literal["sphere", "capsule", "box", "plane", "mesh"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solid:
    """One body of an affector at one time."""

    kind: SolidKind
    matrix: F64
    """From the body's frame: rotation and translation; its uniform scale is in the sizes. The
    identity for a mesh that is deformed."""
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[unit] sphere: (radius, -, -), about the origin; capsule: (radius at -z, radius at +z, half
    of the distance between the centres), along z; box: half edges; plane: -, z < 0 is inside; mesh:
    -."""
    surface: Surface | None = None
    """Surface of a mesh, in its own frame."""
    is_rigid: bool = True
    """Whether only `matrix` changes over time."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Affector:
    """A prim with SplatAffectorAPI at one time."""

    path: str
    parameters: AffectorParameters
    solids: tuple[Solid, ...]
    """The same number, of the same kinds, at every time."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Deformer:
    """An instance of SplatDeformerAPI at one time."""

    name: str
    parameters: DeformParameters
    frame: F64
    """From the deformer's space to the simulation's."""
    mask: F32 | None = None
    """Factor of the weight, for each splat of the state, shape (n,); the solver sets it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Driver:
    """An instance of SplatDriverAPI at one time."""

    name: str
    parameters: DriverParameters


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Picture:
    """A texture that is projected onto splats."""

    pixels: F32
    """One channel, the top row first, shape (h, w)."""
    to_clip: F64 | None = None
    """From the simulation's space to the clip space of a camera, shape (4, 4); None for other
    projections."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LevelSet:
    """Signed distances from a surface on a grid, negative inside."""

    voxels: F32
    """Distances [voxel], shape (nz, ny, nx), at least 2 along each axis."""
    band: float
    """Distance up to which they are those of a file [voxel]; elsewhere they are this far, with the
    sign of their side."""
    to_grid: F64
    """From the mask's frame to voxels, uniform, shape (4, 4)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Mask:
    """An instance of SplatSimMaskAPI at one time. The same object at another time has the same
    values."""

    name: str
    parameters: MaskParameters
    frame: F64
    """From the mask's space to the simulation's."""
    primvar: F32 | None = None
    """Values of the capture's splats, shape (n,), of source primvar."""
    regions: tuple[Affector, ...] = ()
    """Affectors of source affector; their roles do not matter."""
    picture: Picture | None = None
    level_set: LevelSet | None = None
    curves: Surface | None = None
    """Curves as triangles without area, one for each segment."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SkinBinding:
    """Binding of splats to joints; constant over time."""

    indices: I32 | None
    """Joints that the capture's splats follow, shape (n, k); None if `surface` binds them."""
    weights: F32 | None
    """Weights of the joints, rows sum to 1, shape (n, k)."""
    bind: F64
    """`skel:geomBindTransform` in the simulation's space, shape (4, 4)."""
    surface: Surface | None = None
    """Mesh at bind time, in the simulation's space, from which splats take their weights."""
    surface_indices: I32 | None = None
    """Joints of the mesh's points, shape (p, k)."""
    surface_weights: F32 | None = None
    """Weights of these joints, shape (p, k)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SkinPose:
    """The skeleton at one time."""

    joints: F64
    """Matrix of each joint from bind time to now, in the simulation's space, shape (j, 4, 4)."""
    surface: Surface | None = None
    """The binding's mesh now, for binding by triangles."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Moment:
    """Everything that a simulation reads from the stage at one time."""

    time: float
    """Time [time code]."""
    parameters: Parameters
    to_world: F64
    """From the simulation's space to the stage's."""
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Unit vector that points up on the stage."""
    affectors: tuple[Affector, ...] = ()
    """Ordered by path; the same ones at every time."""
    target: Surface | None = None
    """Mesh that splats conform to."""
    becomes: SplatCloud | None = None
    """Capture that splats become, in the simulation's space; the same one at every time."""
    order: F32 | None = None
    """Primvar of `conform:orderPrimvar`, shape (n,)."""
    relax_surface: Surface | None = None
    """Mesh that redistribution keeps splats on."""
    deformers: tuple[Deformer, ...] = ()
    """In the order of the stack."""
    drivers: tuple[Driver, ...] = ()
    """Ordered by name."""
    skin: SkinPose | None = None
    masks: Mapping[str, Mask] = field(default_factory=dict)
    """Masks by name."""
    masked: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Parameter -> names of the masks that multiply it, such as "growth:rate",
    "deform:bend:weight" or "/World/Wind.affector:amount"."""


class Recipe(Protocol):
    """A field and everything that acts on it. Stages implement it; tests write their own."""

    @property
    def path(self) -> str:
        """Path of the field."""

    @property
    def rest(self) -> SplatCloud:
        """The capture, in the simulation's space. Arrays may be read-only."""

    @property
    def selection(self) -> F32 | None:
        """`primvars:splatSim:weight`, shape (n,), 0 to 1; None where all are selected."""

    @property
    def binding(self) -> SkinBinding | None:
        """Binding of the field to a skeleton; None without one."""

    @property
    def codes_per_second(self) -> float:
        """Time codes in a second."""

    def at(self, time: float) -> Moment:
        """Return the values of the stage at a time code, whole or fractional."""
