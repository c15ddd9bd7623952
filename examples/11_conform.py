"""Conform a capture to a mesh: splats spread over a rotating ring, and lie flat on it.

python examples/11_conform.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat import main as usdsplat
from usdsplat import procedural_capture, schema

FIELD, RING = "/World/Capture", "/World/Simulation/Ring"
LAST = 24
SETTINGS = (
    "conform:start=0",
    "conform:duration=0.5",
    "conform:stagger=0.25",
    "conform:keepThickness=0",  # of the capture's surface
    "settle:omega=40",
)


def main(folder: Path) -> Path:
    """Write capture.usdc, conform.usda with the simulation, and conformed.usda with the result.

    Return conformed.usda.
    """
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(stage, FIELD, procedural_capture(6_000))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    stage.Save()
    made, baked = folder / "conform.usda", folder / "conformed.usda"
    assert usdsplat(f"simulate --preset conform {folder}/capture.usdc -o {made}".split()) == 0
    command = ["simulate", str(made), "-o", str(baked), "--frames", f"1:{LAST}"]
    for setting in SETTINGS:
        command += ["--set", setting]
    assert usdsplat(command) == 0
    return baked


def check(path: Path) -> None:
    """Check that centres are on the ring, and that the shortest axes are along its normals: nearly,
    as splats keep together with their neighbours."""
    stage = Usd.Stage.Open(str(path))
    field, ring = stage.GetPrimAtPath(FIELD), UsdGeom.Mesh.Get(stage, RING)
    points = np.array(ring.GetPointsAttr().Get(), np.float64)
    tube = points[:, 1].max()
    radius = points[:, 0].max() - tube
    away = []
    for frame in (1, LAST):
        cloud = schema.fetch(field, frame)
        place = np.array(ring.ComputeLocalToWorldTransform(frame))
        local = (cloud.positions - place[3, :3]) @ place[:3, :3].T
        spokes = local * (1, 0, 1)
        spokes *= radius / np.linalg.norm(spokes, axis=1, keepdims=True)
        out = local - spokes
        far = np.linalg.norm(out, axis=1)
        away.append(np.abs(far - tube))
    thin, middle, _ = np.sort(cloud.scales, axis=1).T
    flat = middle > 1.5 * thin  # needles and balls have no unique shortest axis
    normals = (out / far[:, None]) @ place[:3, :3]
    axes = smallest_axes(cloud.rotations, cloud.scales)
    lying = np.abs(np.sum(axes * normals, axis=1))[flat]
    typical, most = np.percentile(lying, (50, 5))
    print(
        f"from the ring {np.median(away[0]):.3f} m, then at most {away[1].max():.1e} m; "
        f"axis · normal of {flat.sum()} flat splats is {typical:.5f}, above {most:.2f} for 95 %"
    )
    assert away[1].max() < 0.05 * tube
    assert flat.sum() > 1000
    assert typical > 0.999 and most > 0.85


def smallest_axes(rotations: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Return the direction of the shortest axis of each ellipsoid, shape (n, 3)."""
    w, x, y, z = rotations.astype(np.float64).T
    columns = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return columns[scales.argmin(axis=1), :, np.arange(len(scales))]


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
