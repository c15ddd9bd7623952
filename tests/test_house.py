"""Tests of house rules that no linter checks."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "usdsplat"
MOST = 8
"""Parameters of a function; more become values with names."""


def parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Names of a function's parameters, without `self` and `cls`."""
    arguments = node.args
    every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    return [each.arg for each in every if each.arg not in ("self", "cls")]


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """("file:name", function) of every function of the package outside `kernels`."""
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if place.parts[0] == "kernels":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{place.as_posix()}:{node.name}", node


def test_no_function_has_more_than_eight_parameters() -> None:
    """Oracle: the syntax trees of all modules outside `kernels`."""
    found = [(name, len(parameters(node))) for name, node in functions()]
    assert len(found) > 1000
    assert [name for name, count in found if count > MOST] == []


LEFT = {
    "Shot", "Prepared", "Visible", "Painter", "PlainPicture", "Behind", "Thinning", "Filling",
    "Reading", "Writing", "Sums", "Moments", "Scratch", "Laying", "Wanted", "Goal", "Way", "Desk",
    "Bridge", "Newest",
}  # fmt: skip
"""Names of classes that the house's table of names replaces."""


def test_no_class_has_a_name_that_was_replaced() -> None:
    """Oracle: the syntax trees of all modules."""
    found = {
        node.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    }
    assert len(found) > 300
    assert found & LEFT == set()


WRITERS = {
    "core/output.py": "writes all files",
    "core/renames.py": "puts them in place",
    "schema/usd_files.py": "writes all USD files, through core/output",
}
"""Modules that write files."""
ALLOWED = {
    "formats/sog/target.py": "a zip in the open file of an output",
    "kernels/store.py": "the cache of kernels, which is shared and may be lost",
    "preview/web/recording.py": "a zip in memory, which the page saves",
    "images/texture.py": "a temporary copy of a packed texture, to read it",
    "cli/view.py": "a page that redirects the browser, removed at the end of the session",
    "core/lock.py": "the lock of an output, which is no result",
    "cli/crash_log.py": "the stack of a crash",
    "cli/failures.py": "the report of an error that was not foreseen",
    "cli/streams.py": "standard streams that were closed",
    "jobs/forked.py": "the pipes and standard streams of a forked process",
    "schema/generate.py": "source code of this package, written by its developers",
    "sim/schema_source.py": "source code of this package, written by its developers",
}
"""Modules that write something else than results, and what."""
WRITING = {
    "Export", "Save", "CreateNew", "CreateNewUsdzPackage", "CreateNewARKitUsdzPackage",
    "write_text", "write_bytes", "tofile", "NamedTemporaryFile", "mkstemp", "mkdtemp",
}  # fmt: skip
"""Methods and functions that write files."""
OF_OS = {"replace", "rename", "link"}
OPENING = {"open", "ZipFile", "fdopen"}


def writes(node: ast.Call) -> str:
    """The name of a call that writes a file, or ""."""
    name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
    name = node.func.id if isinstance(node.func, ast.Name) else name
    owner = node.func.value if isinstance(node.func, ast.Attribute) else None
    if name in WRITING:
        return name
    if name in OF_OS and isinstance(owner, ast.Name) and owner.id == "os":
        return f"os.{name}"
    words = [each.value for each in ast.walk(node) if isinstance(each, ast.Constant)]
    words += [each.attr for each in ast.walk(node) if isinstance(each, ast.Attribute)]
    modes = [word for word in words if isinstance(word, str)]
    is_writing = any(mode[:1] in {*"wax"} and len(mode) < 4 for mode in modes)
    is_used = name in OPENING and "devnull" not in modes
    return name if is_used and (is_writing or "O_CREAT" in modes) else ""


def test_files_are_written_by_one_function() -> None:
    """Oracle: the syntax trees of all modules. Every module of the exceptions has such a call, so
    that the list cannot grow old."""
    found: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        calls = {
            writes(node)
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call)
        }
        if calls - {""}:
            found[path.relative_to(PACKAGE).as_posix()] = calls - {""}
    assert {name: calls for name, calls in found.items() if name not in {*WRITERS, *ALLOWED}} == {}
    assert {*WRITERS, *ALLOWED} <= found.keys()


PRINTERS = {
    "preview/usdview/container.py",  # in usdview's process, which has no console of ours
    "schema/generate.py",  # programs of developers
    "sim/schema_source.py",
}


def test_only_the_console_prints() -> None:
    """Oracle: the syntax trees of all modules. `cli/console.py` survives a closed or full stream,
    and escapes what would break a line."""
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in PRINTS
    }
    assert found - {"cli/console.py"} == PRINTERS


PRINTS = {"print", "sys.stdout.write", "sys.stderr.write", "traceback.print_exc"}


def test_the_process_that_forks_has_one_thread_and_loads_little() -> None:
    """Oracle: a fresh process that has loaded the entry point of the command; locks of other
    threads would stay locked in the child."""
    code = (
        "import sys, threading; import usdsplat.cli.supervise; "
        "print(threading.active_count(), *sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    count, *loaded = run.stdout.split()
    assert count == "1"
    heavy = {"numpy", "pxr", "numba", "argparse", "logging", "json", "pathlib", "shutil"}
    assert heavy & set(loaded) == set()


RAW = {
    "GetStageUpAxis",
    "GetLocalToWorldTransform",
    "GetParentToWorldTransform",
    "ComputeLocalToWorldTransform",
    "ComputeParentToWorldTransform",
    "ComputeRelativeTransform",
    "ComputeWorldBound",
    "ComputeUntransformedBound",
    "ComputeExtentsHint",
    "GetLocalTransformation",
    "GetOrderedXformOps",
    "TransformMightBeTimeVarying",
}


def test_only_one_module_asks_usd_for_values_that_may_be_anything() -> None:
    """Oracle: the syntax trees of all modules. These calls raise USD's own errors, or return any
    word, for a damaged stage; `schema/stage_values.py` has checked ones."""
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr in RAW
    }
    assert found == {"schema/stage_values.py"}
