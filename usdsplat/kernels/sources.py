"""Hash the sources of a kernel: its module and all modules that it imports.

Docstrings, comments and line breaks do not matter: a module is hashed as its syntax tree.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import json
from pathlib import Path

from usdsplat.kernels import store

PACKAGE = "usdsplat"
ROOT = Path(__file__).parents[1]
ASIDE = frozenset(
    f"usdsplat.kernels.{name}"
    for name in (
        "store", "sources", "signatures", "ahead", "unloaded", "compiling", "device", "devices",
        "cuda.device",
        "cuda.support", "cuda.primitives", "cuda.compiling", "cuda.cub",
        "cuda.transfers", "cuda.launch", "cuda.arrays",
    )
)  # fmt: skip
"""Modules that only launch or store kernels: they do not change what a kernel computes."""


@functools.cache
def digest(module: str) -> str:
    """Return the hash of a module of this package and of all modules that it imports.

    Args:
        module: Full name. It is hashed even if it is one of ASIDE.

    Raises:
        OSError: If a source cannot be read.
    """
    found: dict[str, str] = {}
    pending = [module]
    while pending:
        name = pending.pop()
        if name not in found and (name == module or name not in ASIDE):
            found[name], imports = _read(name)
            pending += imports
    text = "".join(f"{name}={found[name]}\n" for name in sorted(found))
    return hashlib.sha256(text.encode()).hexdigest()


# --- private -------------------------------------------------------------------------------


def _read(module: str) -> tuple[str, list[str]]:
    """Return the hash of one module, and the modules of the package that it imports. Parsing takes
    milliseconds, so the result is stored."""
    path = _file(module)
    if path is None:
        raise FileNotFoundError(f"{module}: found no source, expected an installation with sources")
    source = path.read_bytes()
    key = store.key_of("source", _own_hash(), module, hashlib.sha256(source).hexdigest())
    kept = store.load(key)
    if kept is not None:
        normal, imports = json.loads(kept)
        return normal, imports
    tree = ast.parse(source)
    imports = sorted(_imports(tree, module))
    normal = hashlib.sha256(ast.dump(_WithoutTexts().visit(tree)).encode()).hexdigest()
    store.save(key, json.dumps([normal, imports]).encode())
    return normal, imports


@functools.cache
def _own_hash() -> str:
    """Return the hash of this file: results of another version of it are not used."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


def _file(module: str) -> Path | None:
    path = ROOT.joinpath(*module.split(".")[1:])
    for each in (path.with_suffix(".py"), path / "__init__.py"):
        if each.is_file():
            return each
    return None


class _WithoutTexts(ast.NodeTransformer):
    """Transformer that removes all docstrings."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else node


def _imports(tree: ast.Module, module: str) -> set[str]:
    names: set[str] = set()
    is_package = _file(module) == ROOT.joinpath(*module.split(".")[1:], "__init__.py")
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = module.split(".")[: None if is_package else -1]
            if node.level:
                above = above[: len(above) - node.level + 1]
                base = ".".join([*above, node.module] if node.module else above)
            else:
                base = node.module or ""
            names.add(base)
            names |= {f"{base}.{each.name}" for each in node.names}
    ours = {name for name in names if name.split(".")[0] == PACKAGE}
    return {name for name in ours if _file(name) is not None}
