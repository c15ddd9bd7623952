"""Edit a capture, write it in every format, and read it back; also stages and sequences.

python examples/14_formats.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pxr import Gf, Usd, UsdGeom

from usdsplat import SplatCloud, edit, formats, procedural_capture, schema
from usdsplat import main as usdsplat

EDITS = ["--rotate", "0,0,90", "--crop-sphere", "0,0,0,0.8", "--sh-degree", "1", "--morton"]
"""Edits, applied in this order: rotate, crop, reduce the harmonics, sort by position."""

THINNEST = 5e-5
"""Standard deviation that every format can store. SPZ has the largest limit, exp(-10)."""

DC = 0.28209
"""Harmonic of degree 0: change of a colour per change of its coefficient."""

PROMISED = {
    # positions, log scales, rotations [degree], opacities, colours, harmonics
    "ply": (0, 1e-6, 1e-2, 1e-6, 1e-6, 1e-6),
    "compressed.ply": (1e-3, 0.01, 0.27, 1 / 509, 0.01, 1 / 31),
    "spz": (2**-13, 1 / 31.9, 0.28, 1 / 509, 0.0135, 1 / 15.9),
    "sog": (1e-4, 0.03, 1.5, 1 / 254, 0.02, 0.25),
    "splat": (0, 1e-6, 0.9, 1 / 509, 0.5 / 254 / DC, None),
    "glb": (0, 1e-6, 1e-2, 1e-6, 1e-6, 1e-6),
    "usdc": (1e-6, 1e-6, 1e-2, 1e-6, 1e-6, 1e-6),
}
"""Suffix -> largest differences between written and read values; None for values that are not
stored.

For formats whose tables or boxes are fitted to the capture, bounds apply to this capture.
"""

FRAMES = (1, 2, 3)


def main(folder: Path) -> Path:
    """Write edited.* in each format, a stage with two fields, and a sequence. Return the folder."""
    formats.write(
        edit.take(procedural_capture(20_000), slice(None, None, 20)), folder / "capture.ply"
    )

    def convert(*words: str) -> None:
        assert usdsplat(["convert", *words]) == 0

    scan, edited = str(folder / "capture.ply"), str(folder / "edited.ply")
    convert(scan, *EDITS, edited)
    for suffix in PROMISED:
        if suffix != "ply":
            convert(edited, f"{folder}/edited.{suffix}")
        convert(f"{folder}/edited.{suffix}", f"{folder}/back_{suffix}.ply", "--axes", "rdf")

    stage = Usd.Stage.CreateNew(str(folder / "pair.usda"))
    for name, move in (("Left", Gf.Vec3d(-1, 0, 0)), ("Right", Gf.Vec3d(1, 0, 0))):
        field = schema.author(stage, f"/World/{name}", formats.read(edited).cloud)
        place = UsdGeom.Xformable(field)
        place.AddTranslateOp().Set(move)
        place.AddRotateYOp().Set(90)
    stage.Save()
    convert(f"{folder}/pair.usda", f"{folder}/pair.ply", "--axes", "rub")  # the stage's axes
    convert(f"{folder}/pair.usda", f"{folder}/one.ply", "--axes", "rub", "--split")

    for frame in FRAMES:
        convert(edited, "--translate", f"{frame},0,0", f"{folder}/frame.{frame:04}.ply")
    convert(f"{folder}/frame.####.ply", f"{folder}/shot.usdc")
    convert(f"{folder}/shot.usdc", f"{folder}/again.####.ply")
    return folder


def check(folder: Path) -> None:
    """Check that the values read are those written, within each format's bounds."""

    def read(name: str) -> SplatCloud:
        return formats.read(folder / f"{name}.ply").cloud

    source, edited = read("capture"), read("edited")
    turned = np.stack([-source.positions[:, 1], source.positions[:, 0]], axis=1)
    kept = np.linalg.norm(source.positions, axis=1) <= 0.8
    assert len(edited) == kept.sum() < len(source)
    assert edited.sh_degree == 1
    np.testing.assert_allclose(
        np.sort(edited.positions[:, :2], axis=0), np.sort(turned[kept], axis=0), atol=1e-6
    )

    for suffix, bounds in PROMISED.items():
        apart = differences(read(f"back_{suffix}"), edited)
        print(f"{suffix:15}", *(f"{value:10.2g}" for value in apart))
        for value, bound in zip(apart, bounds, strict=True):
            assert bound is None or value <= bound, suffix

    pair = read("pair").positions
    moved = edited.positions[:, [2, 1, 0]] * np.float32([1, 1, -1])  # by 90 degrees about y
    sides = np.concatenate([moved - np.float32([1, 0, 0]), moved + np.float32([1, 0, 0])])
    np.testing.assert_allclose(pair, sides, atol=1e-6)
    parts = [read(f"one_{name}").positions for name in ("Left", "Right")]
    np.testing.assert_array_equal(np.concatenate(parts), pair)

    for frame in FRAMES:
        there, back = read(f"frame.{frame:04}"), read(f"again.{frame:04}")
        assert max(differences(back, there)[:2]) <= 1e-6


def differences(ours: SplatCloud, theirs: SplatCloud) -> tuple[float, ...]:
    """Return the largest difference of each kind in `PROMISED`.

    Splats are matched by position, because formats reorder them.
    """
    apart = np.square(ours.positions[:, None] - theirs.positions[None]).sum(axis=2)
    theirs = edit.take(theirs, apart.argmin(axis=1))
    chord = [ours.rotations + sign * theirs.rotations for sign in (1, -1)]
    chord_length = np.minimum(*(np.linalg.norm(each.astype(float), axis=1) for each in chord))
    shared = min(ours.sh.shape[1], theirs.sh.shape[1])
    return (
        _largest(ours.positions, theirs.positions),
        _largest(*(np.log(np.maximum(each.scales, THINNEST)) for each in (ours, theirs))),
        float(np.degrees(4 * np.arcsin(chord_length.max() / 2))),
        _largest(ours.opacities, theirs.opacities),
        _largest(ours.sh[:, 0], theirs.sh[:, 0]),
        _largest(ours.sh[:, 1:shared], theirs.sh[:, 1:shared]),
    )


def _largest(ours: npt.NDArray[np.float32], theirs: npt.NDArray[np.float32]) -> float:
    return float(np.abs(ours - theirs).max(initial=0))


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    target.mkdir(parents=True, exist_ok=True)
    check(main(target))
