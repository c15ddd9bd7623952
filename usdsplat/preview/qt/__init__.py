"""The window: Qt widgets over plain values, without access to stages, files or engines."""

from usdsplat.preview.qt.immortal import make_immortal

make_immortal()
