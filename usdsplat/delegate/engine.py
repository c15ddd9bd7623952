"""The engine: renders pictures of one stage at one time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.core.findings import Finding
from usdsplat.delegate.default_camera import Seen, frame_all, seen_of
from usdsplat.delegate.drawer import Drawer
from usdsplat.delegate.live_clouds import LiveClouds
from usdsplat.delegate.product import ProductSpec
from usdsplat.delegate.render_buffer import Pixels
from usdsplat.delegate.render_index import RenderIndex
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.scene_delegate import Stage, UsdSceneDelegate, find_products
from usdsplat.delegate.stage_info import StageInfo
from usdsplat.delegate.time_sampler import other_times
from usdsplat.render.band import BAND_PIXELS, Band
from usdsplat.render.cost import Work
from usdsplat.render.deep_memory import USUAL_SIZE, DeepSize
from usdsplat.render.deep_samples import DeepSamples
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.lod.memory import estimate
from usdsplat.render.memory import COLOR_ALONE, Estimate, PictureRequest
from usdsplat.render.patience import ENDLESS, Patience
from usdsplat.render.renderer import ReadHoldout, TimeSampler, depends_on_time
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing, View

PURPOSES = ("default", "render")


class Engine:
    """A render scene of one stage at one time; views of it are values.

    Edits of the stage are noticed, and only affected data is read again. Engines share nothing. An
    engine is used by one thread at a time, and the stage must not be edited while the engine syncs
    or a `render` is in progress.

    Args:
        stage: A Usd.Stage, which the engine never edits.
        device: "auto", or a device name of `kernels.devices.open_device`.
        threads: Number of threads; None for all.
        time: Time code; "first" is that of the stage's range, if it has one; None is USD's default.
        purposes: Drawn purposes: default, render, proxy, guide.
        refinement: Refinement level of subdivision surfaces, 0 to 5.

    Raises:
        BackendError: If the device is not usable here; it is opened on first use.
        UsageError: If the refinement or the number of threads is out of range.
    """

    def __init__(
        self,
        stage: Stage,
        *,
        device: str = "auto",
        threads: int | None = None,
        time: float | Literal["first"] | None = "first",
        purposes: tuple[str, ...] = PURPOSES,
        refinement: int = 2,
    ) -> None:
        self._param = RenderParam(RenderScene())
        self._index = RenderIndex(self._param)
        self._drawer = Drawer(self._param, device, threads)
        self._scene: UsdSceneDelegate | None = UsdSceneDelegate(
            stage, self._index, time=time, purposes=purposes, refinement=refinement
        )

    # --- the stage -------------------------------------------------------------------------

    @property
    def time(self) -> float | None:
        """The time code; None for USD's default time."""
        return self._open().time

    def set_time(self, time: float | None) -> None:
        """Go to a time code, or None for the default time; only data that varies is read again."""
        self._open().set_time(time)

    def set_purposes(self, purposes: tuple[str, ...]) -> None:
        """Set the drawn purposes."""
        self._open().set_purposes(purposes)

    def set_refinement(self, levels: int) -> None:
        """Set the refinement level of subdivision surfaces; only meshes are rebuilt.

        Raises:
            UsageError: If it is not 0 to 5.
        """
        self._open().set_refinement(levels)

    def sync(self, view: View | None = None) -> None:
        """Bring the render scene up to date with the stage, and LOD roots with a view."""
        (scene := self._open()).apply_pending_updates(view)
        self._index.sync_all(scene)

    def update_chunk(self, path: str, node: int, cloud: SplatCloud | None) -> None:
        """Draw a cloud in place of the splats of a splat tree's node; None draws those again.

        Its degree is the tree's; its splats are as many as the node's proxies and residents, in
        order. It must not be changed afterwards.

        Raises:
            UsdSplatError: If there is no such tree or node, or the cloud does not fit it.
        """
        self._open().update_chunk(path, node, cloud)

    def show_live(self, live: LiveClouds | None) -> None:
        """Draw clouds in place of those on the stage at their time; None draws those again."""
        self._open().show_live(live)

    @property
    def device(self) -> str:
        """Name of the device."""
        return self._drawer.renderer.device

    @property
    def remark(self) -> str:
        """Reason why a faster device is not used, or ""; it changes if a GPU fails."""
        return self._drawer.renderer.remark

    @property
    def version(self) -> int:
        """Version number that grows with each synced change of the drawn scene."""
        return self._param.version

    @property
    def pulls(self) -> Mapping[str, int]:
        """Number of reads from the stage so far, by kind."""
        return dict(self._open().pulls)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the stage asks for and does not get at the current time; syncs first."""
        self.sync()
        return self._open().findings

    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentences of `findings`, and of a GPU with a problem; syncs first."""
        return (*filter(None, [self.remark]), *(each.message for each in self.findings))

    @property
    def render_scene(self) -> RenderScene:
        """The render scene, after a sync; read only."""
        self.sync()
        return self._param.scene

    @property
    def stats(self) -> FrameStats:
        """Statistics of the last picture."""
        return self._drawer.renderer.stats

    def drawn_paths(self) -> tuple[str, ...]:
        """Return the paths of the drawn prims; entry i has the value i in the AOV primId."""
        return self.render_scene.draw_list().prims

    # --- views -----------------------------------------------------------------------------

    def stage_info(self) -> StageInfo:
        """Return the rates, the unit, the files and the drawable prims of the stage."""
        self.sync()
        return self._open().stage_info()

    def cameras(self) -> list[str]:
        """Return the paths of the stage's cameras, sorted."""
        self.sync()
        return sorted(self._index.cameras)

    def fields(self) -> list[str]:
        """Return the paths of the stage's splat fields, visible or not, sorted."""
        self.sync()
        return sorted(self._index.fields)

    def meshes(self) -> list[str]:
        """Return the paths of the stage's meshes and shapes, visible or not, sorted."""
        self.sync()
        return sorted(self._index.meshes)

    def view(
        self,
        camera: str | None = None,
        *,
        resolution: tuple[int, int] | None = None,
        framing: Framing | None = None,
    ) -> View:
        """Return the view of a camera at the current time.

        Args:
            camera: Path of the prim; None for a camera that frames everything visible.
            resolution: Resolution [pixel]; replaces that of `framing`.
            framing: Resolution, data window and conform policy.

        Raises:
            StageError: If there is no such camera, or it is not usable.
        """
        self.sync()
        framing = framing or Framing()
        framing = replace(framing, resolution=resolution or framing.resolution)
        return View(camera=self._camera(camera, framing), framing=framing)

    def framing_camera(
        self, times: Iterable[float | None], *, framing: Framing | None = None
    ) -> CameraSpec:
        """Return a camera that frames everything visible at any of `times`; keeps the time."""
        before, views = self.time, []
        try:
            for time in times:
                self.set_time(time)
                views.append(seen_of(self.render_scene))
        finally:
            self.set_time(before)
        return self._around(views, framing or Framing())

    def products(
        self,
        settings_path: str | None = None,
        *,
        camera: str | None = None,
        resolution: tuple[int, int] | None = None,
        overrides: Mapping[str, Any] | None = None,
    ) -> tuple[ProductSpec, ...]:
        """Return the products of the stage's render settings; empty if it has none.

        Args:
            settings_path: Path of the RenderSettings prim, or of a RenderPass that renders one;
                None for the settings that the stage names, or else its first. If exactly one
                RenderPass renders the settings, it applies without being named.
            camera: Path that replaces the authored cameras.
            resolution: Resolution [pixel]; replaces the authored ones.
            overrides: Values of `RenderSettings` that replace the authored ones.

        Raises:
            StageError: If `settings_path` is neither, or an authored value is invalid.
            UsageError: If an override is invalid.
        """
        return find_products(
            self._open().stage, time=self.time, settings_path=settings_path, camera=camera,
            resolution=resolution, overrides=overrides or {},
        )  # fmt: skip

    # --- pictures --------------------------------------------------------------------------

    def expect(self, work: Iterable[Work]) -> None:
        """Set the work by which "auto" selects the device; by default it is a long session."""
        self.sync()
        self._drawer.expect(work)

    def render(
        self,
        view: View,
        settings: RenderSettings | None = None,
        aovs: tuple[str, ...] = ("color",),
        *,
        holdout: ReadHoldout | None = None,
        band_pixels: int = BAND_PIXELS,
    ) -> Iterator[Band]:
        """Return the bands of a picture, top to bottom; memory holds the splats and one band.

        The scene must not be edited before the last band is consumed.

        Args:
            view: The view. For samples at other times, a camera of the stage moves with time; its
                properties that `view` overrides stay constant.
            settings: Render settings.
            aovs: Names from `renderer.AOVS`.
            holdout: Function that reads a holdout for pixels x0, y0, x1, y1; see `images.holdout`.
            band_pixels: Approximate number of pixels per band.
        """
        self.sync(view)
        how = self._resolved(settings)
        return self._drawer.renderer.render(
            self._param.scene, view, how, aovs, sampler=self._times(view, how, aovs),
            holdout=holdout, band_pixels=band_pixels,
        )  # fmt: skip

    def render_deep(
        self,
        view: View,
        settings: RenderSettings | None = None,
        aovs: tuple[str, ...] = (),
        *,
        holdout: ReadHoldout | None = None,
        size: DeepSize = USUAL_SIZE,
    ) -> Iterator[tuple[int, int, DeepSamples]]:
        """Return all contributions to every pixel, in strips of a band: (y0, y1, samples).

        Colours are premultiplied, linear, in the working space; sorted by zDepth or rayHitDistance.
        `aovs` are ids, names in `deep_samples.DEEP_IDS`. Other arguments are those of `render`.

        Raises:
            UsageError: If splats are sorted by another key, or a row has too many samples.
        """
        self.sync(view)
        how = self._resolved(settings)
        return self._drawer.renderer.render_deep(
            self._param.scene, view, how, aovs, sampler=self._times(view, how, ()),
            holdout=holdout, size=size,
        )  # fmt: skip

    def picture(
        self,
        view: View,
        settings: RenderSettings | None = None,
        aovs: tuple[str, ...] = ("color",),
        *,
        sync: bool = True,
        patience: Patience = ENDLESS,
    ) -> dict[str, Pixels]:
        """Return a whole picture; it is drawn only if it differs from the last one.

        Args:
            view, settings, aovs: As for `render`.
            sync: False draws the last synced state; only motion blur and AOVs of motion read USD.
            patience: What it waits for; `Cancelled` is raised if it ends the picture.

        Returns:
            Pixels of the data window by AOV, read-only, shape (height, width) or, for color,
            (height, width, 4): premultiplied, in the colour space of `settings`.
        """
        if sync:
            self.sync(view)
        self._open()
        settings = self._resolved(settings)
        buffers = {name: self._index.buffer(name) for name in aovs}
        draw, sampler = self._drawer.render_pass.execute, self._times(view, settings, aovs)
        draw(view, settings, aovs, buffers, sampler=sampler, patience=patience)
        return {name: buffer.map() for name, buffer in buffers.items()}

    def estimate(
        self,
        view: View,
        settings: RenderSettings | None = None,
        request: PictureRequest = COLOR_ALONE,
        *,
        band_pixels: int = BAND_PIXELS,
    ) -> Estimate:
        """Estimate the memory of a picture; arguments as in `memory.estimate`."""
        self.sync()
        return estimate(
            self._param.scene, view, self._resolved(settings), request, band_pixels=band_pixels,
            threads=self._drawer.threads,
        )  # fmt: skip

    def close(self) -> None:
        """Release arrays, buffers and notices; the engine cannot be used afterwards."""
        if self._scene is None:
            return
        self._scene.close()
        self._scene = None
        self._index.close()
        self._param.scene.close()
        self._drawer.close()

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- private ---------------------------------------------------------------------------

    def _times(self, view: View, how: RenderSettings, aovs: tuple[str, ...]) -> TimeSampler | None:
        """Return a sampler of scene and view at other times, if the picture needs it."""
        if not depends_on_time(how, view.camera, aovs):
            return None
        return other_times(
            self._param.scene, view, frame=self.time, go=self._go,
            spec=getattr(self._index.cameras.get(view.camera.path), "spec", None),
            camera=lambda: self._camera(view.camera.path, view.framing),
        )  # fmt: skip

    def _go(self, time: float) -> None:
        self.set_time(time)
        self.sync()

    def _open(self) -> UsdSceneDelegate:
        if self._scene is None:
            raise UsageError("engine", "a closed one", "an open one")
        return self._scene

    def _resolved(self, settings: RenderSettings | None) -> RenderSettings:
        return (settings or RenderSettings()).resolved(h for _, h in self._index.sorting_hints())

    def _around(self, views: Iterable[Seen], framing: Framing) -> CameraSpec:
        return frame_all(views, up_axis=self._open().up_axis, aspect=framing.aspect)

    def _camera(self, path: str | None, framing: Framing) -> CameraSpec:
        if path is None:
            return self._around([seen_of(self._param.scene)], framing)
        spec = self._index.find_camera(path).spec
        if spec is None:
            raise self._open().problems[path, "camera"]
        return spec
