"""Scale the colours of deep samples so that they flatten to a flat picture.

Compositing blends deep samples linearly, but flat pictures are blended in the space in which the
captures were trained. A factor for each pixel removes the difference.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.products.flattening import flattened
from usdsplat.render.deep_samples import DeepSamples

MEANING = (
    "premultiplied linear radiance of one sample in the space of colorInteropID, scaled per pixel "
    "so that the flattened samples equal the flat picture; A = its opacity"
)
"""Meaning of the colour channels in the header."""
MOST = 16.0
"""Largest factor. What is missing then is added to all samples by their opacities."""
LEAST = 1e-6
"""Flattened colour, relative to the coverage, below which there is nothing to scale."""


def scaled_to(samples: DeepSamples, beauty: F32, dtype: npt.DTypeLike) -> DeepSamples:
    """Return samples that flatten to the colour of `beauty`, with the same opacities.

    Each channel of a pixel is multiplied by a factor. Where the samples are black or almost so, no
    factor gives the beauty. The colour that is missing is then added to all samples of the pixel,
    by their opacities.

    Args:
        samples: The samples.
        beauty: Premultiplied RGBA, linear, shape (h, w, 4); its A is not used.
        dtype: Type of the colours in the file, to which the result is rounded.
    """
    out = samples.color.copy()
    out[:, 3] = out[:, 3].astype(dtype)  # the opacities with which readers flatten
    flat = flattened(replace(samples, color=out))
    color, cover = flat[..., :3].astype(np.float64), flat[..., 3:].astype(np.float64)
    wanted = beauty[..., :3].astype(np.float64)
    factor = np.divide(wanted, color, out=np.ones_like(color), where=color > LEAST * cover)
    factor = np.clip(factor, 0, MOST)
    more = np.zeros_like(color)
    np.divide(wanted - factor * color, cover, out=more, where=cover > 0)
    counts, most = samples.counts.ravel(), np.finfo(dtype).max
    for c in range(3):
        out[:, c] *= np.repeat(factor[..., c].ravel().astype(np.float32), counts)
        out[:, c] += out[:, 3] * np.repeat(more[..., c].ravel().astype(np.float32), counts)
        out[:, c] = np.clip(out[:, c], -most, most).astype(dtype)
    return replace(samples, color=out)
