"""Tests of the hash of a kernel's sources."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest

from usdsplat.kernels import ahead, signatures, sources, store

OWN = Path(sources.__file__).parents[1]


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of the package that may be edited, with nothing kept of it."""
    root = tmp_path / "usdsplat"
    for name in ("core", "kernels"):
        shutil.copytree(OWN / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(OWN / "__init__.py", root)
    monkeypatch.setattr(sources, "ROOT", root)
    monkeypatch.setattr(store, "_chosen", tmp_path / "kept")
    sources.digest.cache_clear()
    yield root
    sources.digest.cache_clear()


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_every_kernel_is_made_of_something(device):
    """Oracle: the hash of nothing, under which an edit would go unseen."""
    for module in {ahead._module_of(name) for name, _ in signatures.table(device)}:
        assert sources.digest(module) != hashlib.sha256(b"").hexdigest(), module


def digests(*names):
    sources.digest.cache_clear()
    return [sources.digest(f"usdsplat.kernels.{name}") for name in names]


def edit(package, name, old, new):
    path = package / "kernels" / f"{name}.py"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_formula_counts_where_it_is_imported_and_nowhere_else(package):
    """Oracle: the imports, read by eye: `bins` needs `project`, `color` does not; `cuda.walk` does
    by way of `cuda.tile`."""
    names = "project", "bins", "cuda.walk", "color"
    before = digests(*names)
    assert len(set(before)) == 4
    edit(package, "project", "scale = -0.5 / det", "scale = -0.25 / det")
    changed = [a != b for a, b in zip(before, digests(*names), strict=True)]
    assert changed == [True, True, True, False]


def test_docstrings_comments_and_lines_do_not_count(package):
    """Oracle: the digest before, with and without what was kept of the parsed source."""
    (before,) = digests("bins")
    edit(package, "project", '"""Fill columns', '"""What it does, in other words. Fill columns')
    edit(package, "bins", "from __future__", "# a comment\n\n\nfrom __future__")
    assert digests("bins") == [before]
    assert digests("bins") == [before]


def test_what_launches_and_keeps_kernels_does_not_count(package):
    """Oracle: the digest before."""
    before = digests("bins", "cuda.walk")
    edit(package, "devices", "START = 1.5", "START = 2.5")
    edit(package, "cuda/transfers", "SMALL = ", "SMALL = 1 + ")
    assert digests("bins", "cuda.walk") == before
