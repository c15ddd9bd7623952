"""Draw a sequence as a job of two processes, in tiles, and write the same job for a farm.

python examples/16_jobs.py [FOLDER]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import OpenImageIO as oiio

from usdsplat import formats, procedural_capture
from usdsplat import main as usdsplat

SIZE = ["--resolution", "160x120", "--frames", "1-2", "--device", "cpu"]


def main(folder: Path) -> Path:
    """Write alone.0001.exr, job.0001.exr and so on, and the folder bundle. Return the folder."""
    scan = folder / "capture.ply"
    formats.write(procedural_capture(5_000), scan)
    words = ["render", str(scan), *SIZE]
    usdsplat([*words, "-o", str(folder / "alone.####.exr")])
    usdsplat([*words, "-o", str(folder / "job.####.exr"), "--jobs", "2", "--tiles", "2x1"])
    usdsplat([*words, "-o", "farm.####.exr", "--openjd", str(folder / "bundle")])
    return folder


def check(folder: Path) -> None:
    """Check that the pictures of the job are those of one process, and that the bundle has the
    frames."""
    for frame in ("0001", "0002"):
        alone, job = (oiio.ImageBuf(str(folder / f"{n}.{frame}.exr")) for n in ("alone", "job"))
        assert not oiio.ImageBufAlgo.compare(alone, job, 0, 0).maxerror
    template = json.loads((folder / "bundle" / "template.yaml").read_text(encoding="utf-8"))
    defaults = {each["name"]: each["default"] for each in template["parameterDefinitions"]}
    assert defaults["Frames"] == "1-2" and (folder / "bundle" / defaults["Stage"]).is_file()


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    target.mkdir(parents=True, exist_ok=True)
    check(main(target))
