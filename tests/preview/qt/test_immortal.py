"""Tests that Qt can be called any number of times."""

from __future__ import annotations

import subprocess
import sys


def test_ten_thousand_calls_leave_the_interpreter_alive() -> None:
    """Oracle: the exit status; without help PySide6 6.12 ends Python 3.11 after a few hundred."""
    program = """
import usdsplat.preview.qt
from PySide6.QtCore import QCoreApplication, QObject, Signal

class Sender(QObject):
    sent = Signal()

application = QCoreApplication([])
sender = Sender()
for _ in range(10_000):
    sender.sent.emit()
    application.processEvents()
print("alive")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip()) == (0, "alive"), done.stderr
