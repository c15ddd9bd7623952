"""Options and report of the building of a splat tree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from usdsplat.core.findings import Finding
from usdsplat.formats import READ_OPTIONS, ReadOptions

MEMORY = 4 << 30
"""Default limit of memory [byte]."""
LEAF_SPLATS = 16_384
"""Default maximum number of splats of a node. Larger nodes span more sizes on the screen, so that
a budget draws views coarser; of smaller ones, more must be chosen and read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LodOptions:
    """Options of `build_tree`. All but `memory_limit` change the tree."""

    axes: str | None = None
    """Axes of all captures, such as "rdf"; None or "auto" chooses those of each, as for imports."""
    up_axis: str | None = None
    """Up axis of the file, "Y" or "Z"; None is that of the first input if it is a stage, else
    "Y"."""
    meters_per_unit: float | None = None
    """Metres per unit of all captures and of the file; None uses what the inputs state, else 1."""
    time: float | None = None
    """Time code of stages; None is the default value, or the first sample where there is none."""
    sh_degree: int | None = None
    """Highest degree of the harmonics, 0 to 4; None is the highest of the inputs."""
    leaf_splats: int = LEAF_SPLATS
    """Largest number of splats of a leaf, and of proxies of a node."""
    pixel: float | None = None
    """Size of the pixel whose low-pass is baked into merged splats [unit of the file], at most the
    size of all inputs; 0 bakes none. None is the footprint of the photographs where it is authored,
    else that of a picture of 540 lines that frames an input, and 0 if all inputs are antialiased.
    """
    memory_limit: int = MEMORY
    """Memory of the process [byte]; what does not fit is on disk beside the target."""
    reading: ReadOptions = READ_OPTIONS
    """Options of the readers of captures."""


LOD = LodOptions()
"""Default options."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LodReport:
    """Report of the building of a tree."""

    sources: tuple[str, ...]
    target: str
    prim_path: str
    """Path of the tree."""
    splats: int
    """Number of splats of all leaves."""
    degree: int
    nodes: int
    leaves: int
    levels: int
    """Number of nodes from the root to the deepest leaf."""
    chunks: int
    residents: int
    """Number of splats that are too large for a leaf."""
    size: int
    """Total size of the chunks [byte]."""
    leaf_size: int
    """Size of the splats of the leaves and of the residents in packed form [byte]."""
    coarse: tuple[int, ...]
    """Number of splats of each stock field for other renderers, the finest first."""
    coarse_size: int
    """Size of the layer with these fields [byte]."""
    pixel: float
    """See `LodOptions.pixel` [unit of the file]."""
    errors: tuple[float, float]
    """Smallest and largest error of inner nodes [unit of the file]; zeros without inner nodes."""
    frame: str
    """Axes of the tree's own coordinates."""
    axes: str
    """Change of axes from the tree's own coordinates to the stage's, one sentence."""
    meters_per_unit: float
    """Unit of the stage."""
    continued: bool
    """Whether an interrupted building was continued."""
    error_bounds: Mapping[str, str] = field(default_factory=dict)
    """Maximum error by field of the leaves; fields that are not listed are exact."""
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    """What stages ask for and do not get."""
