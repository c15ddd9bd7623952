"""Header entries that users add to pictures.

Their names may not be those of entries with a meaning for readers of the format, or of ours: a
wrong value there makes a file unreadable, or wrong about itself.
"""

from __future__ import annotations

import math
import re

from usdsplat.core.errors import UsageError
from usdsplat.core.text import shown
from usdsplat.images.layout import Entry

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.:/ -]{0,78}")
"""Names that EXR and PNG can hold; PNG allows 79 bytes."""

FLOATS = ("isoSpeed", "longitude", "latitude", "altitude", "utcOffset", "whiteLuminance")
"""Standard attributes of OpenEXR that are floating-point numbers."""

OWNERS = ("usdsplat", "cryptomatte", "oiio", "openexr", "png", "smpte", "exif", "iptc", "xmp")
"""First parts of names that belong to us, to Cryptomatte, or to the reader's own entries."""

RESERVED = frozenset(
    name.lower()
    for name in (
        # OpenEXR's required attributes, and standard ones that are no text
        "channels", "compression", "dataWindow", "displayWindow", "lineOrder", "pixelAspectRatio",
        "screenWindowCenter", "screenWindowWidth", "tiles", "name", "type", "version",
        "chunkCount", "maxSamplesPerPixel", "chromaticities", "adoptedNeutral", "envmap", "keyCode",
        "preview", "multiView", "view", "deepImageState", "dwaCompressionLevel", "idManifest",
        "worldToCamera", "worldToNDC", "framesPerSecond", "timeCode", "expTime", "aperture",
        "focus", "pinholeFocalLength", "nominalFocalLength", "effectiveFocalLength",
        "entrancePupilOffset", "sensorCenterOffset", "sensorOverallDimensions",
        "sensorPhotositePitch", "sensorAcquisitionRectangle", "imageRotation", "xDensity",
        "shutterAngle", "tStop", "colorInteropID", "capDate",
        # OpenImageIO's names of these and of others
        "DateTime", "Orientation", "PixelAspectRatio", "XResolution", "YResolution",
        "ResolutionUnit", "ICCProfile", "textureformat", "Software", "HostComputer",
        "ExposureTime", "FNumber", "FocalLength", "worldtoscreen", "cameraCCTSetting",
        "cameraTintSetting", "cameraIdentifier", "originalDataWindow", "captureRate",
    )
)  # fmt: skip
"""Names, in lower case, that `entry` refuses."""

_MOST = 3.4028234663852886e38
"""Largest number of single precision."""
_INTEGER = re.compile(r"-?(?:0|[1-9]\d{0,9})")
_NUMBER = re.compile(r"-?(?:0|[1-9]\d*)\.\d+")


def entry(where: str, name: str, value: Entry) -> tuple[str, Entry]:
    """Return an entry whose name a user may add.

    Args:
        where: Origin of the entry in error messages.
        name: Name of the entry.
        value: Its value; text is stored in one line.

    Raises:
        UsageError: If the name is reserved, or EXR or PNG cannot hold it.
    """
    if not _NAME.fullmatch(name):
        expected = "a name of up to 79 letters, digits and . : / - _, which begins with a letter"
        raise UsageError(where, repr(name), expected)
    first = re.split(r"[:/]", name, maxsplit=1)[0].lower()
    is_owned = first in OWNERS and first != name.lower()
    if is_owned or name.lower() in RESERVED:
        raise UsageError(where, repr(name), "a name that pictures do not use otherwise")
    if name in FLOATS:
        if isinstance(value, bool | str) or not isinstance(value, int | float):
            raise UsageError(where, f"{name} {value!r}", "a number")
        value = float(value)
    _check_numbers(where, name, value)
    return name, shown(value) if isinstance(value, str) else value


def _check_numbers(where: str, name: str, value: Entry) -> None:
    """Raise an error if a number does not fit into a header, whose numbers have 32 bits.

    Raises:
        UsageError: If an integer has more than 32 bits, or a float is not finite in single
            precision.
    """
    numbers = value if isinstance(value, tuple) else (value,)
    for number in numbers:
        if isinstance(number, int) and not -(2**31) <= number < 2**31:
            raise UsageError(where, f"{name} {number}", "a whole number of 32 bits")
        if isinstance(number, float) and not abs(number) <= _MOST:
            raise UsageError(where, f"{name} {number:g}", "a finite number of single precision")


def parse_entry(where: str, text: str) -> tuple[str, Entry]:
    """Parse an entry NAME=VALUE; the value is a number if it looks like one, otherwise text.

    A number has no leading zeros or exponent, so that shot=0010 and take=1e5 stay text.

    Raises:
        UsageError: If there is no "=", and as for `entry`.
    """
    name, sign, value = text.partition("=")
    if not sign:
        raise UsageError(where, repr(text), "NAME=VALUE")
    is_integer = _INTEGER.fullmatch(value) and -(2**31) <= int(value) < 2**31
    found: Entry = int(value) if is_integer else value
    if not is_integer and _NUMBER.fullmatch(value) and math.isfinite(float(value)):
        found = float(value)
    return entry(where, name.strip(), found)
