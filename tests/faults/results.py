"""Read results back, by other code than what checks them while they are written."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Usd

from usdsplat import formats

_PARTS = re.compile(
    r"\d{4}\.usdc|coarse\.usdc|samples\.usdc|kept_checkpoint|frame\.\d+\.usdc|topology\.usda|"
    r"manifest\.usda|meta\.json|\w+(\.\d+)?\.webp"
)


def is_part(path: Path) -> bool:
    """Return whether a file belongs to the folder of a finished result."""
    return _PARTS.fullmatch(path.name) is not None


def read(path: Path) -> object:
    """Return the content of a file or folder, to compare.

    Raises:
        Exception: Of many kinds, if it is damaged.
    """
    if path.is_dir():
        return {each.name: read(each) for each in sorted(path.iterdir())}
    suffix = path.suffix
    if suffix == ".exr" or suffix == ".png":
        return _picture(path)
    if suffix.startswith(".usd"):
        return _stage(path)
    if path.name == "kept_checkpoint":
        return path.read_bytes()
    capture = formats.read(path)
    return capture.cloud.positions.tobytes(), capture.cloud.sh.tobytes()


def _picture(path: Path) -> list[bytes]:
    """Return the pixels of each part."""
    parts = []
    picture = oiio.ImageBuf(str(path))
    for part in range(picture.nsubimages):
        file = oiio.ImageInput.open(str(path))
        file.seek_subimage(part, 0)
        if file.spec().deep:
            samples = file.read_native_deep_image(part, 0)
            assert samples is not None, file.geterror()
            size = samples.pixels
            counts = [samples.samples(pixel) for pixel in range(size)]
            values = [samples.deep_value(pixel, 4, 0) for pixel in range(size) if counts[pixel]]
            parts.append(np.array([*counts, *values]).tobytes())
        else:
            pixels = file.read_image(part, 0, 0, file.spec().nchannels)
            assert pixels is not None, file.geterror()
            parts.append(np.asarray(pixels).tobytes())
        file.close()
    return parts


def _stage(path: Path) -> str:
    """Return the opinions of the root layer as text."""
    if path.suffix == ".usdz":
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
    stage = Usd.Stage.Open(str(path))
    return str(stage.GetRootLayer().ExportToString())
