"""Measure the accuracy of every format: reading, writing, and round trips, with files and readers
of other projects.

    python -m benchmarks.peers        installs the other readers, once
    python -m benchmarks.formats [DATA]

DATA is the folder of the test data; its `oracle` holds 1,000 splats in every format, written and
`DATA` is the folder of the test data. Its `oracle` folder has 1,000 splats in every format, written
and decoded by splat-transform 3.7.0 and GaussianSplats3D 0.4.7. Each number is the largest
difference over all visible splats (opacity of 1/255 and more); the bound below "within" follows
from the format's own rounding (`specs/formats.md`).

read        our reading of their file, against the splats that were encoded
same        our reading of their file, against their own decoding of it
write       their reading (splat-transform) of our file, against the splats that were encoded
round trip  our reading of our file, against the splats that were encoded
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.peers import SplatTransform, missing, splat_transform
from benchmarks.report import Report
from tests.formats.compare import Differences, differences
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.interchange import convert
from usdsplat.interchange.options import ExportOptions, ImportOptions
from usdsplat.schema import Form

VISIBLE = 1 / 255
NAMES = ("position", "log scale", "rotation °", "opacity", "DC", "harmonics")
INFINITE = float("inf")

Bound = tuple[float, float, float, float, float, float]
"""Bound of each of `NAMES`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A format with its files and bounds."""

    name: str
    bound: Bound
    oracle: str | None = None
    """Their file, if there is one."""
    decoded: str | None = None
    """Their decoding of their file."""
    written: str | None = None
    """Name of our file, if we write the format."""
    version: int = 4
    """Version of SPZ."""
    is_read_by_peer: bool = True
    degree: int = 3
    """Highest degree that the format stores."""


EXACT: Bound = (1e-6, 1e-6, 1e-3, 1e-6, 1e-6, 1e-6)
CHUNKS: Bound = (5.7e-3, 1.95e-3, 0.2, 1 / 509, 7e-3, 1 / 63)
BYTES: Bound = (1e-6, 1e-6, 1.8, 1 / 254, 1 / 254 / 0.28209, 0.0)  # rotations cut to 1/128
SPZ: Bound = (1.3e-4, 1 / 31.9, 0.2, 1 / 509, 0.0132, 0.067)
SOG: Bound = (5.4e-4, 0.0105, 1.42, 1 / 254, 0.009, INFINITE)
CASES = (
    Case(name=".ply", bound=EXACT, oracle="tiny.ply", decoded="tiny.ply", written="a.ply"),
    Case(
        name="compressed .ply",
        bound=CHUNKS,
        oracle="out.compressed.ply",
        decoded="rt_compressed_ply.ply",
        written="a.compressed.ply",
    ),
    Case(
        name=".splat",
        bound=BYTES,
        oracle="ours.splat",
        decoded="rt_splat.ply",
        written="a.splat",
        degree=0,
    ),
    Case(
        name=".spz v3",
        bound=SPZ,
        oracle="out_v3.spz",
        decoded="rt_spz_v3.ply",
        written="a.spz",
        version=3,
    ),
    Case(name=".spz v4", bound=SPZ, oracle="out_v4.spz", decoded="rt_spz_v4.ply", written="b.spz"),
    Case(name=".sog", bound=SOG, oracle="out.sog", decoded="rt_sog.ply", written="a.sog"),
    Case(name=".ksplat 0", bound=(*BYTES[:5], 1e-6), oracle="k0.ksplat", decoded="rt_k0.ply"),
    Case(
        name=".ksplat 1",
        bound=(6.5e-5, 1e-3, 0.1, 1 / 254, BYTES[4], 5e-4),
        oracle="k1.ksplat",
        decoded="rt_k1.ply",
    ),
    Case(
        name=".ksplat 2",
        bound=(6.5e-5, 1e-3, 0.1, 1 / 254, BYTES[4], 0.008),
        oracle="k2.ksplat",
        decoded="rt_k2.ply",
    ),
    Case(name=".glb", bound=EXACT, oracle="out.glb", written="a.glb", is_read_by_peer=False),
    Case(name="USD float", bound=EXACT, written="a.usdc", is_read_by_peer=False),
    Case(
        name="USD half",
        bound=(1e-6, 6e-4, 0.06, 3e-4, 1.1e-3, 1.1e-3),
        written="half.usdc",
        is_read_by_peer=False,
    ),
    Case(
        name="USD packed",
        bound=(1e-6, 1e-3, 0.01, 1e-3, 0.02, 0.02),
        written="packed.usdc",
        is_read_by_peer=False,
    ),
)


def matched(cloud: SplatCloud, source: SplatCloud) -> tuple[SplatCloud, SplatCloud]:
    """Return both clouds in the order of `cloud`, without the splats of `source` that it lacks."""
    apart = cloud.positions[:, None].astype(np.float64) - source.positions[None]
    nearest = np.einsum("ijk,ijk->ij", apart, apart).argmin(axis=1)
    return cloud, edit.take(source, nearest)


def compare(cloud: SplatCloud, source: SplatCloud, degree: int) -> Differences:
    """Compare the visible splats of two clouds in any order."""
    ours, theirs = matched(cloud, edit.with_sh_degree(source, degree))
    return differences(ours, theirs, theirs.opacities > VISIBLE)


class Sheet:
    """Table of the results, printed row by row."""

    def __init__(self) -> None:
        self.table = Table(title="largest differences; bounds in brackets")
        for name in ("format", "what", *NAMES, "within"):
            self.table.add_column(name, justify="left" if name in ("format", "what") else "right")
        self.failed: list[str] = []

    def add(self, case: Case, what: str, found: Differences, bound: Bound) -> None:
        """Add one comparison."""
        values = astuple(found)
        good = all(value <= limit for value, limit in zip(values, bound, strict=True))
        if not good:
            self.failed.append(f"{case.name} {what}")
        cells = [
            f"{value:.1e} ({'–' if limit == INFINITE else f'{limit:.1e}'})"
            for value, limit in zip(values, bound, strict=True)
        ]
        self.table.add_row(case.name, what, *cells, "yes" if good else "NO")

    def say(self, case: Case, what: str, words: str) -> None:
        """Add the reason why there is no comparison."""
        self.table.add_row(case.name, what, words)


def write(case: Case, source: Path, folder: Path) -> Path:
    """Write our file, and return its path."""
    target = folder / str(case.written)
    form: Form = "half" if case.name == "USD half" else "float"
    form = "packed" if case.name == "USD packed" else form
    convert(
        source,
        target,
        options=ImportOptions(form=form),
        export=ExportOptions(writing=formats.WriteOptions(spz_version=case.version)),
    )
    return target


def back(case: Case, target: Path, folder: Path) -> SplatCloud:
    """Read our file, in the axes of the source."""
    if target.suffix == ".usdc" or case.name == ".glb":
        convert(target, folder / "back.ply", options=ImportOptions(axes="rdf"))
        return formats.read(folder / "back.ply").cloud
    return formats.read(target).cloud


def rows(sheet: Sheet, case: Case, oracle: Path, folder: Path, peer: SplatTransform | None) -> None:
    """Make all comparisons of one format."""
    source_path = oracle / "tiny.ply"
    source = formats.read(source_path).cloud
    if case.oracle:
        ours = read_as_rdf(oracle / case.oracle, folder)
        sheet.add(case, "read", compare(ours, source, ours.sh_degree), case.bound)
        if case.decoded:
            theirs = formats.read(oracle / case.decoded).cloud
            tight = (3e-6, 3e-6, 1.0 if case.name == ".splat" else 1e-3, 3e-6, 1e-5, 1e-5)
            sheet.add(case, "same", compare(ours, theirs, ours.sh_degree), tight)
    if not case.written:
        return
    target = write(case, source_path, folder)
    if not case.is_read_by_peer:
        sheet.say(case, "write", "no other reader")
    elif peer is None:
        sheet.say(case, "write", "no node")
    else:
        peer.convert(target, folder / "theirs.ply")
        theirs = formats.read(folder / "theirs.ply").cloud
        sheet.add(case, "write", compare(theirs, source, theirs.sh_degree), case.bound)
    ours = back(case, target, folder)
    sheet.add(case, "round trip", compare(ours, source, case.degree), case.bound)


def read_as_rdf(path: Path, folder: Path) -> SplatCloud:
    """Read a capture in the axes of the source, which splat-transform rotates for glTF."""
    if path.suffix != ".glb":
        return formats.read(path).cloud
    capture = formats.read(path)
    # T of data/README: glTF's x is our -x, its y is our -y.
    return edit.transform(capture.cloud, np.diag((-1.0, -1.0, 1.0, 1.0)))


def main(report: Report, data: Path) -> int:
    """Print the table. Return 1 if a difference exceeds its bound."""
    for sentence in missing():
        report.say(sentence)
    sheet, peer = Sheet(), splat_transform()
    with tempfile.TemporaryDirectory() as name:
        for case in CASES:
            rows(sheet, case, data / "oracle", Path(name), peer)
    report.show(sheet.table, 200)
    for name in sheet.failed:
        report.say(f"beyond its bound: {name}")
    return 1 if sheet.failed else 0


if __name__ == "__main__":
    default = os.environ.get("USDSPLAT_TEST_DATA") or "../shared/data"
    with Report("formats", sys.argv[1:]) as report:
        status = main(report, Path(*(report.arguments or [default])))
    sys.exit(status)
