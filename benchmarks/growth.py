"""Measure cells that grow on captures: whether they close, and how clearly they are seen.

    python -m benchmarks.growth [CAPTURE ...]

For views from the front and from aside: the coverage inside the silhouette of the capture, relative
to the capture's, and the power of the picture's colour at the wavelength of cells, relative to that
of its surroundings: of waves that are longer by half, and shorter by a third. Rows of packed cells
are closer than their sites, and what has seams has power at half the wavelength too, which is left
out.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Usd

from benchmarks.simulations import ANGLE, CAMERA, Strip, bake, fields, shoot
from usdsplat.delegate.engine import Engine
from usdsplat.render.settings import RenderSettings
from usdsplat.sim.styles import STYLES

CAPTURES = {
    "statue_massa.sog": 205.0, "statue_trumpet.sog": 205.0, "statue_angel.sog": 25.0,
    "pod.spz": 25.0,
}  # fmt: skip
"""Captures, and the angle that sees their front. Cells were tuned on the first one only."""
SIZE = 480
"""Edge of a picture [pixel]."""
LAST = 40
ROWS = 0.8
"""Wavelength of packed cells, relative to the distance that they are asked to have: the power of a
flat picture of cells is largest there."""
BANDS = (0.4, 0.6), (0.8, 1.25), (1.4, 1.65)
"""Frequencies below, of and above the cells, relative to theirs."""


def measure(capture: str, front: float) -> None:
    """Print the figures of a capture."""
    strip = Strip(
        capture=capture, preset="grow", options={"style": "cells"}, frames=(1, LAST), turn=front,
        size=(SIZE, SIZE),
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        baked = bake(strip, Path(folder))
        for name, turn in (("front", front), ("side", front + 90)):
            stage = Usd.Stage.Open(str(baked))
            stage.SetEditTarget(stage.GetSessionLayer())
            shoot(stage, replace(strip, turn=turn))
            first, last = (picture(stage, frame) for frame in strip.frames)
            wave = wavelength(stage, strip)
            inside = first[..., 3] > 0.9
            covered = last[..., 3][inside].sum() / first[..., 3][inside].sum()
            print(
                f"{capture:20} {name:6} {wave:6.1f} {covered:9.4f} {power(last, inside, wave):7.1f}"
            )


def picture(stage: Usd.Stage, frame: int) -> np.ndarray:
    """Return RGBA at a frame, shape (SIZE, SIZE, 4)."""
    with Engine(stage, time=frame) as engine:
        view = engine.view(CAMERA, resolution=(SIZE, SIZE))
        return engine.picture(view, RenderSettings(color_mode="display"))["color"].copy()


def wavelength(stage: Usd.Stage, strip: Strip) -> float:
    """Return the wavelength of cells in the picture, at the capture's middle [pixel]."""
    sim = next(prim for prim in stage.Traverse() if prim.GetTypeName() == "SplatSim")
    spacing = sim.GetAttribute("splatSim:carriers:spacing").Get()
    points = np.concatenate([at for _, at in fields(stage)])
    size = float(np.ptp(np.percentile(points, (5, 95), axis=0), axis=0).max())
    apart = STYLES["cells"].knobs["motif_size"] * spacing
    return ROWS * apart / (strip.height * size) * SIZE


def power(image: np.ndarray, inside: np.ndarray, wave: float) -> float:
    """Return the power of the colour at a wavelength, relative to that of its surroundings.

    The spectrum is that of the part of the picture that is inside, faded at its margin; powers are
    multiplied by the square of the frequency, because those of any picture fall with it.
    """
    light = image[..., :3] @ np.array([0.3, 0.6, 0.1])
    mask = inside.astype(float)
    for _ in range(int(wave)):
        mask[1:-1, 1:-1] = (
            (mask[:-2, 1:-1] + mask[2:, 1:-1] + mask[1:-1, :-2] + mask[1:-1, 2:])
            / 4
            * inside[1:-1, 1:-1]
        )
    mean = (light * mask).sum() / mask.sum()
    spectrum = np.abs(np.fft.fft2((light - mean) * mask)) ** 2
    fy, fx = np.meshgrid(*2 * [np.fft.fftfreq(SIZE)], indexing="ij")
    relative = np.hypot(fx, fy) * wave
    spectrum *= relative**2
    means = [spectrum[(relative > low) & (relative < high)].mean() for low, high in BANDS]
    return float(means[1] / np.sqrt(means[0] * means[2]))


def main(names: list[str]) -> None:
    """Measure these captures, or all."""
    print(f"{ANGLE:g} degrees, {SIZE} x {SIZE} pixel, frame {LAST}")
    print(f"{'capture':20} {'view':6} {'pixels':>6} {'coverage':>9} {'power':>7}")
    for name in names or CAPTURES:
        measure(name, CAPTURES[name])


if __name__ == "__main__":
    main(sys.argv[1:])
