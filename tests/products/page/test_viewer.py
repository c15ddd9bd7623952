"""Tests that the viewer in the package is whole, unmodified, and distributed."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from usdsplat.products.page.document import VIEWER, VIEWER_FILES

ROOT = Path(__file__).resolve().parents[3]


def test_its_files_are_those_of_the_published_version():
    """Oracle: the hashes in its README, which are of the package's files when they were copied."""
    rows = re.findall(r"\| `(.*?)` \| `([0-9a-f]{64})` \|", (VIEWER / "README.md").read_text())
    assert sorted(name for name, _ in rows) == sorted(VIEWER_FILES)
    for name, digest in rows:
        assert hashlib.sha256((VIEWER / name).read_bytes()).hexdigest() == digest
    assert {path.name for path in VIEWER.iterdir()} == {*VIEWER_FILES, "README.md"}


def test_its_version_is_the_one_that_is_named():
    """Oracle: what the viewer itself says."""
    said = re.search(r'^var version = "(.*)";$', (VIEWER / "index.js").read_text(), re.MULTILINE)
    assert said is not None
    assert f"version {said[1]}," in (VIEWER / "README.md").read_text()


def test_wheel_and_sdist_have_it(tmp_path):
    """Oracle: the files of both, built here."""
    pytest.importorskip("hatchling", reason="the wheel is built with hatchling")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"},
        capture_output=True,
        check=True,
    )
    import tarfile

    (wheel,), (sdist,) = tmp_path.glob("*.whl"), tmp_path.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        for name in (*VIEWER_FILES, "README.md"):
            inside = archive.read(f"usdsplat/products/page/viewer/{name}")
            assert inside == (VIEWER / name).read_bytes()
        for name in ("page.js", "page.css"):
            assert f"usdsplat/products/page/{name}" in archive.namelist()
    with tarfile.open(sdist) as archive:
        names = [name.partition("/")[2] for name in archive.getnames()]
    assert {f"usdsplat/products/page/viewer/{name}" for name in VIEWER_FILES} <= set(names)
