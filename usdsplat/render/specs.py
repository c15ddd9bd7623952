"""Plain frozen values that cross from USD prims to the render scene.

The scene delegate makes them, the renderer reads them, and neither needs the other: a picture can
be rendered, and tested, with no USD at all. Matrices are 16 numbers, row-major, for column vectors
(`world = M @ local`); Gf's row-vector matrices are transposed where they are read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from usdsplat.core.cloud import F32, I32, SplatCloud

Matrix = tuple[float, ...]

IDENTITY: Matrix = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)

RasterizeMode = Literal["classic", "antialiased"]
ProjectionMode = Literal["perspective", "tangential"]
SortingMode = Literal["zDepth", "cameraDistance", "rayHitDistance"]
CropShape = Literal["sphere", "cube", "cylinder", "cone", "capsule", "plane"]
Wrap = Literal["black", "clamp", "repeat", "mirror"]

NO_GRADE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedSpec:
    """Splats as a packed prim holds them, but for their centres; see `schema.packing`."""

    words: I32
    """Shape (n, 4)."""
    harmonics: I32
    """All words of each splat in a row, shape (n, 4 w); of degree 0 no rows, shape (0, 4)."""
    color_range: F32
    """Lower, then upper end of red, green and blue, shape (6,)."""
    steps: F32
    """Size of a code of degree 1, 2, ..., shape (degree,)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FieldSpec:
    """The splats of one prim, in its own space, and how it asks to be drawn."""

    cloud: SplatCloud
    color_space: str = "srgb_rec709_scene"
    """Space the harmonics were trained in, a Gf color space name."""
    rasterize_mode: RasterizeMode = "classic"
    projection_mode: ProjectionMode = "perspective"
    sorting_mode: SortingMode = "zDepth"
    grade: tuple[float, ...] = NO_GRADE
    """What the prim's grade does to linear RGB in the primaries of `color_space`: exposure, white
    balance, gain, saturation and matrix are all linear, so they are one 3x3, row-major."""
    packed: PackedSpec | None = None
    """The same splats in a third of the room, where the prim holds them so: for a GPU."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CropSpec:
    """One volume of a garbage matte: splats are kept or left out by their centres.

    The canonical shapes: sphere, the unit ball; cube, [-1, 1] on each axis; cylinder, radius 1
    about z and z in [-1, 1]; cone, base of radius 1 at z = -1 and apex at z = 1; capsule, radius 1
    about the segment from z = -length to z = length; plane, everything at z <= 0.
    """

    shape: CropShape
    world_to_shape: Matrix
    """From the world to the space of the canonical shape."""
    keeps: bool
    """Whether it includes; with any volume that includes, only what is inside one is kept. What
    is inside a volume that does not include is left out, whatever else it is inside of."""
    length: float = 0.0
    """Of a capsule: half the height of its cylinder, in radii."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TextureSpec:
    """A picture on a surface."""

    pixels: F32
    """Linear Rec.709, shape (h, w, 3), row 0 at the top (v = 1)."""
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    """What lies outside, along u and v."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MaterialSpec:
    """What a surface reflects: diffuse × texture × the mesh's colours, each if it is there."""

    diffuse: tuple[float, float, float] = (0.18, 0.18, 0.18)
    """Linear Rec.709."""
    texture: TextureSpec | None = None
    uses_colors: bool = False
    """Whether the mesh's own colours count."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeshSpec:
    """The triangles of one opaque prim, in its own space, counter-clockwise seen from outside."""

    points: F32
    """[scene unit], shape (p, 3)."""
    triangles: I32
    """Rows of `points`, shape (t, 3)."""
    faces: I32
    """Authored face that each triangle is a part of, shape (t,)."""
    normals: F32 | None = None
    """Unit normal at each corner, shape (t, 3, 3); None for those of the triangles themselves."""
    colors: F32 | None = None
    """Linear Rec.709 at each corner, shape (t, 3, 3)."""
    uvs: F32 | None = None
    """Texture coordinates at each corner, shape (t, 3, 2)."""
    materials: tuple[MaterialSpec, ...] = (MaterialSpec(),)
    material_of: I32 | None = None
    """Number of each triangle's material, shape (t,); None when all have the first."""
    double_sided: bool = True
    """Whether triangles seen from behind are there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LightSpec:
    """A light from infinitely far away."""

    direction: tuple[float, float, float]
    """Where the light travels, in the world, unit length."""
    irradiance: tuple[float, float, float]
    """On a surface that faces it, divided by π: what a white diffuse surface then sends out.
    Linear Rec.709."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InstanceSpec:
    """One appearance of a field or a mesh in the world."""

    path: str
    """Path of the prim that is seen; instances of one field differ in it or in `index`."""
    index: int = 0
    """Number within a point instancer, else 0."""
    transform: Matrix = IDENTITY
    """Local to world [scene unit]; sheared and mirrored ones are exact."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSpec:
    """A camera that looks down its own -Z with +Y up."""

    path: str = ""
    world_to_camera: Matrix = IDENTITY
    orthographic: bool = False
    window: tuple[float, float, float, float] = (-0.5, -0.5, 0.5, 0.5)
    """(left, bottom, right, top) of the aperture, offsets included: at distance 1 from the eye for
    a perspective camera, in scene units for an orthographic one."""
    clipping_range: tuple[float, float] = (1.0, 1e6)
    """Near and far planar depth [scene unit]."""
    exposure: float = 1.0
    """What the camera's exposure attributes multiply linear light by."""
    lens_radius: float = 0.0
    """Of the entrance pupil [scene unit]: focal length / (2 fStop); 0 for a pinhole."""
    focus_distance: float = 0.0
    """Planar depth that is sharp [scene unit]; of use only with a lens radius."""
    shutter: tuple[float, float] = (0.0, 0.0)
    """When it opens and closes [time code], relative to the frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Framing:
    """How an image samples the camera's aperture. Pixel (0, 0) is the display window's top left."""

    resolution: tuple[int, int] = (1920, 1080)
    """Display window, width and height [pixel]."""
    data_window: tuple[int, int, int, int] | None = None
    """(x0, y0, x1, y1) [pixel], y down, end exclusive; None means the display window. It may lie
    inside it (crop) or reach outside (overscan)."""
    pixel_aspect_ratio: float = 1.0
    """Width over height of a pixel."""
    conform: str = "expandAperture"
    """A UsdRender aspectRatioConformPolicy token."""
    pixel_scale: float = 1.0
    """Side of a pixel, in pixels of the picture that this one stands for, such as 2 for a preview
    at half the resolution: the low-pass filter is as wide as it is there."""

    @property
    def aspect(self) -> float:
        """Width over height of the display window."""
        return self.pixel_aspect_ratio * self.resolution[0] / self.resolution[1]

    @property
    def window(self) -> tuple[int, int, int, int]:
        """The data window, or the display window when there is none."""
        return self.data_window or (0, 0, *self.resolution)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What is looked at and how it is sampled; as many views of one scene as anybody likes."""

    camera: CameraSpec
    framing: Framing = Framing()
    matte: tuple[tuple[str, bool], ...] = ()
    """Prims that hold out: they hide what is behind them and are not in the picture. A prim goes by
    the longest of these paths that it is at or beneath; True makes it matte."""
