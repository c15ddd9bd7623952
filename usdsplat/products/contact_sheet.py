"""Draw one frame of several stages side by side, with labelled rows and columns."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdsplat.core.progress import Progress
from usdsplat.delegate.default_camera import frame_all, seen_of
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.files import open_stage
from usdsplat.products.display_image import Image, save_image
from usdsplat.products.drawing import write_picture
from usdsplat.products.header import Origin, labelled_layout
from usdsplat.products.picture_file import PictureFile
from usdsplat.products.planning import plan_pictures
from usdsplat.products.preflight import go_to
from usdsplat.products.request import PicturePlan, RenderRequest
from usdsplat.render.specs import CameraSpec
from usdsplat.schema.stage_values import up_axis

WIDTH = 480
"""Width of a cell [pixel]; its height follows from the product's resolution."""
GAP = 8
"""Space around each cell [pixel]."""
_PAPER, _INK, _BEHIND = (250, 250, 248), (30, 32, 36), (32, 34, 38)
_TEXT, _LINE = 15, 20
"""Sizes of text and of a line of it [pixel]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Cells of a contact sheet."""

    cells: Sequence[Path]
    """Stages, row by row."""
    rows: Sequence[str]
    """Label of each row; it may be empty, or have several lines."""
    columns: Sequence[str]
    """Label of each column."""


def draw_sheet(
    sheet: Sheet,
    target: Path,
    *,
    frame: float,
    progress: Progress,
    device: str = "auto",
    threads: int | None = None,
) -> Path:
    """Draw every cell as `usdsplat render` draws it, all with the same camera, into one PNG.

    The camera is that of the stage's first product, or its first camera, or else one that frames
    what is visible on any of the stages.

    Args:
        sheet: The cells; the stages have the same cameras and products.
        target: A .png; an existing one is replaced when the new one is complete.
        frame: Time code.
        progress: Receives the number of finished cells.
        device, threads: As for `Engine`.

    Raises:
        StageError: If a camera or a stage cannot be used.
        OutputError: If the file cannot be written.
    """
    plan, camera = _planned(sheet.cells, frame)
    images = []
    with tempfile.TemporaryDirectory() as folder:
        for number, path in enumerate(sheet.cells):
            progress.step("contact sheet", number, len(sheet.cells))
            picture = Path(folder) / f"{number}.png"
            with Engine(open_stage(path), device=device, threads=threads, time=frame) as engine:
                view = go_to(engine, plan, frame, camera)
                origin = Origin(stage=str(path), frame=frame)
                layout = labelled_layout(engine, plan, view, origin=origin)
                file = PictureFile(plan=plan, path=picture, view=view, layout=layout)
                write_picture(engine, file)
            images.append(_over(picture))
        progress.step("contact sheet", len(sheet.cells), len(sheet.cells))
    return save_image(compose(sheet, images), target)


def compose(sheet: Sheet, images: Sequence[Image]) -> Image:
    """Place pictures of the same size, row by row, with the labels left of rows and above columns.

    Args:
        sheet: The labels.
        images: Shape (height, width, 3) each, as many as rows times columns.
    """
    from PIL import Image as pillow
    from PIL import ImageDraw, ImageFont

    font = ImageFont.load_default(_TEXT)
    height, width, _ = images[0].shape
    left = max(int(font.getlength(line)) for row in sheet.rows for line in row.split("\n"))
    left += GAP if left else 0
    across, down = width + GAP, height + GAP
    size = (left + across * len(sheet.columns) + GAP, _LINE + down * len(sheet.rows) + 2 * GAP)
    page = pillow.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(page)
    for column, label in enumerate(sheet.columns):
        draw.text((left + GAP + column * across, GAP), label, fill=_INK, font=font)
    for row, label in enumerate(sheet.rows):
        top = _LINE + 2 * GAP + row * down
        for number, line in enumerate(label.split("\n")):
            draw.text((GAP, top + number * _LINE), line, fill=_INK, font=font)
        for column in range(len(sheet.columns)):
            cell = pillow.fromarray(images[row * len(sheet.columns) + column])
            page.paste(cell, (left + GAP + column * across, top))
    return np.asarray(page)


def _planned(paths: Sequence[Path], frame: float) -> tuple[PicturePlan, CameraSpec | None]:
    """Return the plan of all pictures, and their camera if it is not one of the stages'."""
    stage = open_stage(paths[0])
    with Engine(stage, device="cpu", time=frame) as engine:
        first = plan_pictures(engine, RenderRequest(output="cell.png", aovs=("color",)))[0]
        columns, rows = first.framing.resolution
        size = (WIDTH, max(1, round(WIDTH * rows / columns)))
        request = RenderRequest(output="cell.png", aovs=("color",), resolution=size)
        plan = plan_pictures(engine, request)[0]
    if plan.camera is not None:
        return plan, None
    views = []
    for path in paths:
        with Engine(open_stage(path), device="cpu", time=frame) as engine:
            engine.set_purposes(plan.purposes)
            views.append(seen_of(engine.render_scene))
    return plan, frame_all(views, up_axis=up_axis(stage), aspect=plan.framing.aspect)


def _over(path: Path) -> Image:
    """Read a PNG over the background, shape (height, width, 3)."""
    from PIL import Image as pillow

    with pillow.open(path) as opened:
        picture = opened.convert("RGBA")
    behind = pillow.new("RGBA", picture.size, (*_BEHIND, 255))
    return np.asarray(pillow.alpha_composite(behind, picture).convert("RGB"))
