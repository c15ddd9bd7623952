"""Reproject the world positions of an EXR by the matrices of its header.

Independent of `usdsplat`: this script uses NumPy and OpenEXR's own Python package, and follows the
texts of OpenEXR's standard attributes. `python tests/products/reprojection.py FILE` prints the
greatest distance of a reprojected position from the centre of its pixel.
"""

from __future__ import annotations

import sys

import numpy as np
import OpenEXR


def read(path):
    """Return the header of a file's first part, and its channels by full name, top row first."""
    file = OpenEXR.File(str(path), separate_channels=True)
    part = file.parts[0]
    return dict(part.header), {name: channel.pixels for name, channel in part.channels.items()}


def centres(header):
    """Return x and y of the centre of each pixel of the data window [pixel]."""
    (x0, y0), (x1, y1) = header["dataWindow"]
    return np.meshgrid(np.arange(x0, x1 + 1) + 0.5, np.arange(y0, y1 + 1) + 0.5)


def positions(channels):
    """Return the world positions as row vectors, shape (rows, columns, 4)."""
    found = np.stack([channels[f"P.{axis}"] for axis in "xyz"], axis=-1).astype(np.float64)
    return np.concatenate([found, np.ones((*found.shape[:2], 1))], axis=-1)


def to_pixels(header, points):
    """Return x and y of points [pixel]: worldToNDC, then the display window."""
    (x0, y0), (x1, y1) = header["displayWindow"]
    ndc = points @ header["worldToNDC"].astype(np.float64)
    u, v = ndc[..., 0] / ndc[..., 3], ndc[..., 1] / ndc[..., 3]
    return x0 + u * (x1 + 1 - x0), y0 + v * (y1 + 1 - y0)


def nuke_camera(header):
    """Return the knobs of Nuke's camera: matrix (column vectors), focal and haperture [mm], and
    win_translate, in halves of the picture's width for both axes.

    Nuke looks down -z; EXR's camera space is left-handed, down +z.
    """
    to_camera = header["worldToCamera"].astype(np.float64).T
    matrix = np.linalg.inv(np.diag([1.0, 1.0, -1.0, 1.0]) @ to_camera)
    shift = 2.0 * np.asarray(header["screenWindowCenter"]) / header["screenWindowWidth"]
    return matrix, header["pinholeFocalLength"], header["sensorOverallDimensions"][0], shift


def through_nuke(header, points):
    """Return x and y of points [pixel] as a camera of Nuke has them.

    Its clip space is square: -1 to 1 over the width, in x and in y. There win_translate is
    subtracted. The middle of the picture is at 0, y up, and a pixel is as wide as it is high
    after division by the pixel aspect ratio. vaperture has no effect.
    """
    matrix, focal, horizontal, shift = nuke_camera(header)
    (x0, y0), (x1, y1) = header["displayWindow"]
    width, height = x1 + 1 - x0, y1 + 1 - y0
    x, y, z, _ = np.moveaxis(points @ np.linalg.inv(matrix).T, -1, 0)
    across = 2.0 * focal / horizontal * x / -z - shift[0]
    up = (2.0 * focal / horizontal * y / -z - shift[1]) * header["pixelAspectRatio"]
    return x0 + (width + across * width) / 2, y0 + (height - up * width) / 2


def main(path):
    header, channels = read(path)
    is_seen = channels["A"] > 0.99
    x, y = to_pixels(header, positions(channels))
    across, down = centres(header)
    distance = np.hypot(x - across, y - down)[is_seen]
    print(f"{len(distance)} pixels, greatest distance {distance.max():.2g} pixels")


if __name__ == "__main__":
    main(sys.argv[1])
