"""Frozen values that describe USD prims to the render scene.

The scene delegate creates them and the renderer reads them. A picture can therefore be rendered,
and tested, without USD. Matrices are 16 numbers, row-major, for column vectors (`world = M @
local`). Gf's row-vector matrices are transposed when they are read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

from usdsplat.core.cloud import F32, I32, SplatCloud

Matrix = tuple[float, ...]

IDENTITY: Matrix = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)

RasterizeMode = Literal["classic", "antialiased", "footprint"]
ProjectionMode = Literal["perspective", "tangential"]
LightingMode = Literal["auto", "captured", "shadowed", "relit"]
LightRules = tuple[tuple[LightingMode, tuple[tuple[str, bool], ...]], ...]
SortingMode = Literal["zDepth", "cameraDistance", "rayHitDistance"]
CropShape = Literal["sphere", "cube", "cylinder", "cone", "capsule", "plane"]
Wrap = Literal["black", "clamp", "repeat", "mirror"]

NO_GRADE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def drawn_mode(mode: str, authored: RasterizeMode, footprint: float) -> RasterizeMode:
    """Return how the low-pass changes opacity.

    Args:
        mode: `RenderSettings.rasterize_mode`.
        authored: Mode of the prim.
        footprint: Size of a pixel of the photographs; 0 if unknown, which leaves the authored mode.
    """
    if mode == "auto" or (mode == "footprint" and not footprint):
        return authored
    return cast(RasterizeMode, mode)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedSpec:
    """Splats in packed form without their centres, see `schema.packing`."""

    words: I32
    """Shape (n, 4)."""
    harmonics: I32
    """All words of each splat in a row, shape (n, 4 w); shape (0, 4) for degree 0."""
    color_range: F32
    """Lower, then upper limit of red, green and blue, shape (6,)."""
    steps: F32
    """Step of the codes of degree 1, 2, ..., shape (degree,)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfaceSpec:
    """Authored normals of the surfaces that n splats lie on."""

    normals: F32
    """Unit vectors in local space, shape (n, 3); 0 where there is none."""
    confidence: F32 | None = None
    """[0..1], shape (n,); None for 1."""
    occlusion: F32 | None = None
    """[0..1], shape (n,); None for 0."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FieldSpec:
    """Splats of one prim in local space, and the prim's rendering hints."""

    cloud: SplatCloud
    color_space: str = "srgb_rec709_scene"
    """Training space of the harmonics, a Gf colour space name."""
    rasterize_mode: RasterizeMode = "classic"
    projection_mode: ProjectionMode = "perspective"
    sorting_mode: SortingMode = "zDepth"
    footprint: float = 0.0
    """Size of a pixel of the photographs at the splats [local unit]; 0 if unknown."""
    grade: tuple[float, ...] = NO_GRADE
    """The prim's grade for linear RGB in the primaries of `color_space`, a 3x3 matrix, row-major.
    Exposure, white balance, gain, saturation and matrix are all linear, so one matrix holds them
    all."""
    packed: PackedSpec | None = None
    """The same splats in packed form, a third of the size, if the prim stores them packed. GPUs use
    it."""
    surface: SurfaceSpec | None = None
    """Authored normals; None if they are computed when they are needed."""
    lighting: LightingMode = "auto"
    """Light of the splats; auto for that of the picture."""
    captured_lights: tuple[str, ...] = ()
    """Paths of the lights in which the splats were photographed; empty if these are estimated."""
    is_catcher: bool = False
    """Whether the prim is a shadow catcher."""

    def drawn_mode(self, mode: str) -> RasterizeMode:
        """Return how the low-pass changes opacity, for `RenderSettings.rasterize_mode`."""
        return drawn_mode(mode, self.rasterize_mode, self.footprint)


@dataclass(frozen=True, slots=True, kw_only=True)
class CropSpec:
    """One volume of a garbage matte, which keeps or removes splats by their centres.

    The canonical shapes: sphere, the unit ball; cube, [-1, 1] on each axis; cylinder, radius 1
    about z and z in [-1, 1]; cone, base of radius 1 at z = -1 and apex at z = 1; capsule, radius 1
    about the segment from z = -length to z = length; plane, everything at z <= 0.
    """

    shape: CropShape
    world_to_shape: Matrix
    """From the world to the space of the canonical shape."""
    keeps: bool
    """Whether the volume includes. If any volume of a field includes, only splats inside an
    including volume are kept. Splats inside a volume that does not include are always removed."""
    length: float = 0.0
    """Half the height of a capsule's cylinder [radius]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TextureSpec:
    """Texture of a surface."""

    pixels: F32
    """Linear Rec.709, shape (h, w, 3), row 0 at the top (v = 1)."""
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    """Wrap modes along u and v."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MaterialSpec:
    """Reflectance of a surface: diffuse × texture × the mesh's colours, as far as they exist."""

    diffuse: tuple[float, float, float] = (0.18, 0.18, 0.18)
    """Linear Rec.709."""
    texture: TextureSpec | None = None
    uses_colors: bool = False
    """Whether the mesh's own colours are used."""
    path: str = ""
    """Path of the material; empty if none is bound."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeshSpec:
    """Triangles of one opaque prim in local space, counter-clockwise seen from outside."""

    points: F32
    """[scene unit], shape (p, 3)."""
    triangles: I32
    """Rows of `points`, shape (t, 3)."""
    faces: I32
    """Authored face that each triangle is a part of, shape (t,)."""
    normals: F32 | None = None
    """Unit normal at each corner, shape (t, 3, 3); None for geometric normals."""
    colors: F32 | None = None
    """Linear Rec.709 at each corner, shape (t, 3, 3)."""
    uvs: F32 | None = None
    """Texture coordinates at each corner, shape (t, 3, 2)."""
    materials: tuple[MaterialSpec, ...] = (MaterialSpec(),)
    material_of: I32 | None = None
    """Number of each triangle's material, shape (t,); None if all have the first one."""
    double_sided: bool = True
    """Whether triangles are visible from behind."""
    is_catcher: bool = False
    """Whether the prim is a shadow catcher."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InstanceSpec:
    """One appearance of a field or a mesh in the world."""

    path: str
    """Path of the visible prim. Instances of one field differ in it or in `index`."""
    index: int = 0
    """Number within a point instancer, else 0."""
    transform: Matrix = IDENTITY
    """Local to world [scene unit]; sheared and mirrored ones are exact."""
    asset: str = ""
    """Path of the asset that the prim belongs to; empty for the prim's own path."""
    material: str = ""
    """Path of the material that is bound to a field; empty without one. Materials of a mesh are
    those of its `MaterialSpec`s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSpec:
    """Camera that looks along its local -Z axis, with +Y up."""

    path: str = ""
    world_to_camera: Matrix = IDENTITY
    orthographic: bool = False
    window: tuple[float, float, float, float] = (-0.5, -0.5, 0.5, 0.5)
    """(left, bottom, right, top) of the aperture, offsets included: at distance 1 from the eye for
    a perspective camera, in scene units for an orthographic one."""
    clipping_range: tuple[float, float] = (1.0, 1e6)
    """Near and far planar depth [scene unit]."""
    focal_length: float = 0.0
    """Focal length [scene unit]; 0 if the camera has none. Pictures depend on `window` only."""
    exposure: float = 1.0
    """Factor on linear light from the camera's exposure attributes."""
    lens_radius: float = 0.0
    """Radius of the entrance pupil [scene unit]: focal length / (2 fStop); 0 for a pinhole."""
    focus_distance: float = 0.0
    """Planar depth in focus [scene unit]; used only with a lens radius."""
    shutter: tuple[float, float] = (0.0, 0.0)
    """Times at which the shutter opens and closes, relative to the frame [time code]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Framing:
    """Sampling of the camera's aperture by an image. Pixel (0, 0) is the display window's top
    left."""

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
    """Side of a pixel in pixels of the full-resolution picture, such as 2 for a preview at half the
    resolution. The low-pass filter then has the same width as in the full picture."""

    @property
    def aspect(self) -> float:
        """Width over height of the display window."""
        return self.pixel_aspect_ratio * self.resolution[0] / self.resolution[1]

    @property
    def window(self) -> tuple[int, int, int, int]:
        """The data window, or the display window if there is none."""
        return self.data_window or (0, 0, *self.resolution)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Camera and sampling of a picture. A scene can have any number of views."""

    camera: CameraSpec
    framing: Framing = Framing()
    matte: tuple[tuple[str, bool], ...] = ()
    """Rules (path, is matte). A matte hides what is behind it and is not in the picture. The
    longest path at or above a prim decides."""
    catchers: tuple[tuple[str, bool], ...] = ()
    """Rules (path, is catcher) in the form of `matte`. A shadow catcher is a matte on which the AOV
    of shadows is drawn. Prims that are catchers by themselves are added."""
    light_rules: LightRules = ()
    """Light of splats in place of that of the settings: (mode, rules in the form of `matte`). The
    first whose rules contain a prim decides. Prims with a light of their own keep it."""
