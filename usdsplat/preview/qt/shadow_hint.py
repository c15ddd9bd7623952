"""A notice that shadows are asked for that nothing casts, and a button for those of a capture."""

from __future__ import annotations

from dataclasses import replace

from PySide6.QtCore import QObject

from usdsplat.preview.qt.message_bar import MessageBar
from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.told import ALONE
from usdsplat.preview.values import Picture


class ShadowHint(QObject):
    """The notice; it comes once for each time that it becomes true.

    Args:
        context: Context of the session.
        notices: Shows the notice.
    """

    def __init__(self, context: PanelContext, notices: MessageBar) -> None:
        super().__init__(notices)
        self._context, self._notices = context, notices
        self._is_said = False
        context.proxy.picture.connect(self._follow)

    def _follow(self, picture: Picture) -> None:
        is_true = ALONE in picture.warnings
        if is_true and not self._is_said:
            self._notices.say(ALONE, action="Self shadows", act=self._shadow)
        elif not is_true and self._notices.sentence == ALONE:
            self._notices.clear()
        self._is_said = is_true

    def _shadow(self) -> None:
        settings = replace(self._context.look.settings, self_shadows=True)
        self._context.set_look(settings=settings)
