"""Plain frozen values that cross from USD prims to the render scene.

The scene delegate makes them, the renderer reads them, and neither needs the other: a picture can
be rendered, and tested, with no USD at all. Matrices are 16 numbers, row-major, for column vectors
(`world = M @ local`); Gf's row-vector matrices are transposed where they are read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from usdsplat.core.cloud import SplatCloud

Matrix = tuple[float, ...]

IDENTITY: Matrix = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)

RasterizeMode = Literal["classic", "antialiased"]
ProjectionMode = Literal["perspective", "tangential"]
SortingMode = Literal["zDepth", "cameraDistance", "rayHitDistance"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FieldSpec:
    """The splats of one prim, in its own space, and how it asks to be drawn."""

    cloud: SplatCloud
    color_space: str = "srgb_rec709_scene"
    """Space the harmonics were trained in, a Gf color space name."""
    rasterize_mode: RasterizeMode = "classic"
    projection_mode: ProjectionMode = "perspective"
    sorting_mode: SortingMode = "zDepth"


@dataclass(frozen=True, slots=True, kw_only=True)
class InstanceSpec:
    """One appearance of a field in the world."""

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

    @property
    def window(self) -> tuple[int, int, int, int]:
        """The data window, or the display window when there is none."""
        return self.data_window or (0, 0, *self.resolution)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What is looked at and how it is sampled; as many views of one scene as anybody likes."""

    camera: CameraSpec
    framing: Framing = Framing()
