"""Fixture with a small document."""

from __future__ import annotations

import pytest

from tests.preview.documents import Shown, animated
from usdsplat.preview.document import Document
from usdsplat.preview.pacing import FULL


@pytest.fixture
def stage():
    """Two fields, one of them animated, and a camera."""
    return animated()


@pytest.fixture
def events():
    """What the document publishes."""
    return Shown()


@pytest.fixture
def document(stage, events):
    """Open."""
    document = Document(stage, publish=events.append)
    yield document
    document.close()


@pytest.fixture
def paced(monkeypatch):
    """Says how to draw while a view moves; at rest it is in full."""

    def pace(quality, middle=None):
        monkeypatch.setattr("usdsplat.preview.pacing.Pacer.moving", lambda self, now, load: quality)
        if middle is not None:
            monkeypatch.setattr(
                "usdsplat.preview.pacing.Pacer.resting",
                lambda self, shown, load: (
                    FULL if shown is not None and shown.is_at_least(middle) else middle
                ),
            )

    return pace
