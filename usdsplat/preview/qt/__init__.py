"""The window: Qt widgets over plain values. Nothing here touches a stage, a file or an engine."""

from usdsplat.preview.qt.immortal import make_immortal

make_immortal()
