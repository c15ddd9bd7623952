"""Say what usdsplat finds on this machine, what is missing, and how to get it.

examples:
  usdsplat doctor
      versions, devices, caches, plug-ins, and what each missing part is needed for
  usdsplat doctor --json
      the same for scripts, and for a report of a problem

notes:
  Nothing is changed, compiled or drawn. A line with an arrow has a cure. The exit status is 1 if
  something is missing that commands cannot do without, and 0 if only optional parts are.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

from usdsplat import __version__
from usdsplat.cli import console
from usdsplat.cli.arguments import option
from usdsplat.cli.plugin_path import VARIABLE
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.core.text import shown
from usdsplat.core.wording import counted, said_bytes

NEEDS = {
    "view": "the window of 'view'",
    "cuda": "NVIDIA GPUs",
    "plots": "info --plot",
    "vdb": "masks from OpenVDB level sets",
    "farm": "--dask",
}
"""Extra of the package -> what it is needed for."""
PROGRAMS = {"ffmpeg": "flipbooks as .mp4 and .mov", "usdview": "the docks in usdview"}
"""Program -> what it is needed for."""
SETTINGS = (
    "USDSPLAT_CACHE_DIR", "USDSPLAT_SUPERVISE", "USDSPLAT_THREADS", VARIABLE, "OCIO",
    "SOURCE_DATE_EPOCH", "CUDA_VISIBLE_DEVICES", "QT_QPA_PLATFORM",
)  # fmt: skip
"""Environment variables that change what commands do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat doctor`."""

    json: Annotated[bool, option()] = False
    """print one JSON object: the lines by section"""
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """What was found of one thing."""

    name: str
    found: str
    cure: str = ""
    """What to do to get what is missing; "" if nothing is."""
    is_needed: bool = False
    """Whether commands cannot do without what is missing."""


def run(options: Options, reporter: Reporter) -> int:
    """Print what was found, by section."""
    sections = {
        "usdsplat": _known(_itself()),
        "packages": _known(_packages()),
        "devices": _known(_devices()),
        "kernels": _known(_kernels()),
        "USD plug-ins": _known(_plugins()),
        "window": _known(_window()),
        "programs": _known(_programs()),
        "environment": _known(_environment()),
    }
    if options.json:
        reporter.print_json({name: [*map(asdict, lines)] for name, lines in sections.items()})
    else:
        for name, lines in sections.items():
            console.say("\n".join([name, *map(_text, lines)]))
    return int(any(line.is_needed for lines in sections.values() for line in lines))


def _known(lines: Iterator[Line]) -> list[Line]:
    """Return the lines of a section, as far as they can be known without packages that lack."""
    found: list[Line] = []
    try:
        for line in lines:
            found.append(line)
    except ImportError as error:
        found.append(Line(name="the rest", found=f"cannot be known without {error.name}"))
    return found


def _text(line: Line) -> str:
    """Return a line as it is printed."""
    text = f"  {line.name:22} {shown(line.found)}"
    return f"{text}\n    -> {line.cure}" if line.cure else text


def _itself() -> Iterator[Line]:
    yield Line(name="version", found=__version__)
    yield Line(name="folder", found=str(Path(__file__).parents[1]))
    yield Line(name="Python", found=f"{platform.python_version()}, {sys.executable}")
    yield Line(name="system", found=platform.platform())


def _packages() -> Iterator[Line]:
    """Yield the packages that the installation asks for, with those of the extras."""
    try:
        asked = importlib.metadata.requires("usdsplat") or []
    except importlib.metadata.PackageNotFoundError:
        yield Line(name="usdsplat", found="not installed as a package", cure="pip install .")
        return
    wanted: dict[str, str] = {}
    for requirement in asked:
        name = re.match(r"[\w.-]+", requirement)
        extra = re.search(r"extra == ['\"](\w+)['\"]", requirement)
        if name is not None and (extra is None or extra[1] in NEEDS):
            wanted.setdefault(name[0], "" if extra is None else extra[1])
    for package, extra_name in wanted.items():
        yield _package(package, extra_name)


def _package(name: str, extra: str) -> Line:
    """Return the version of a package, or what it is needed for."""
    try:
        return Line(name=name, found=importlib.metadata.version(name))
    except importlib.metadata.PackageNotFoundError:
        if name == "usd-core" and importlib.util.find_spec("pxr") is not None:
            return Line(name=name, found="none, but the pxr of another USD is there")
        if not extra:
            return Line(name=name, found="missing", cure=f"pip install {name}", is_needed=True)
        found = f"not installed; needed for {NEEDS[extra]}"
        return Line(name=name, found=found, cure=f"pip install 'usdsplat[{extra}]'")


def _devices() -> Iterator[Line]:
    from usdsplat.core.system_memory import free
    from usdsplat.kernels.cuda import support

    yield Line(name="CPU", found=f"{counted(os.cpu_count() or 1, 'core')}, {platform.machine()}")
    if available := free():
        yield Line(name="free memory", found=said_bytes(available))
    if (capability := support.capability()) is None:
        yield Line(name="GPU", found="no NVIDIA GPU that its driver can use")
        return
    major, minor = capability
    found = f"{counted(support.gpu_count(), 'GPU')}, compute capability {major}.{minor}"
    missing = support.obstacle()
    yield Line(name="GPU", found=found, cure=missing[1] if missing else "")


def _kernels() -> Iterator[Line]:
    """Yield the folder and size of compiled kernels, and for each device whether it has all."""
    from usdsplat.kernels import ahead, store
    from usdsplat.kernels.cuda import support

    folder = store.folder()
    if folder is None:
        cure = "set USDSPLAT_CACHE_DIR to a folder"
        yield Line(name="folder", found="none: no home directory", cure=cure)
        return
    sizes = [path.stat().st_size for path in folder.glob("*/*") if path.is_file()]
    yield Line(name="folder", found=str(folder))
    yield Line(name="stored", found=f"{counted(len(sizes), 'file')}, {said_bytes(sum(sizes))}")
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not os.access(there, os.W_OK):
        cure = "set USDSPLAT_CACHE_DIR to a folder that can be written, or compile as its owner"
        yield Line(name="access", found="read only", cure=cure)
    has_gpu = support.has_gpu() and support.obstacle() is None
    for device in ("cpu", "cuda") if has_gpu else ("cpu",):
        is_ready = ahead.is_noted(device, support.capability() if device == "cuda" else None)
        found = "all compiled" if is_ready else "not all compiled; they are on first use"
        yield Line(name=device, found=found, cure="" if is_ready else "usdsplat compile")


def _plugins() -> Iterator[Line]:
    """Yield whether USD knows the schemas, and whether other applications will."""
    from pxr import Usd

    from usdsplat.schema import registration

    folder = registration.plugin_folder()
    is_there = (folder / "plugInfo.json").is_file()
    cure = "" if is_there else "install usdsplat again"
    yield Line(name="USD", found=".".join(map(str, Usd.GetVersion())))
    yield Line(name="schemas", found=str(folder), cure=cure, is_needed=not is_there)
    is_known = registration.is_available()
    found = "known to USD in this process" if is_known else "not known to USD"
    cure = "" if is_known else f"{VARIABLE}={folder}"
    yield Line(name="types", found=found, cure=cure, is_needed=not is_known)
    listed = [Path(each) for each in os.environ.get(VARIABLE, "").split(os.pathsep) if each]
    for_others = folder in [path.resolve() for path in listed]
    found = f"{'on' if for_others else 'not on'} {VARIABLE}"
    cure = "" if for_others else 'eval "$(usdsplat plugin-path --export)"'
    yield Line(name="other applications", found=found, cure=cure)


def _window() -> Iterator[Line]:
    from usdsplat.preview.screen import obstacle

    missing = obstacle()
    if missing is None:
        yield Line(name="view", found="can show a window")
    else:
        yield Line(name="view", found=missing[0], cure=missing[1])


def _programs() -> Iterator[Line]:
    for name, need in PROGRAMS.items():
        found = shutil.which(name)
        if found:
            yield Line(name=name, found=found)
        else:
            yield Line(name=name, found=f"not found; needed for {need}")


def _environment() -> Iterator[Line]:
    """Yield the variables that are set and change what commands do."""
    given = {name: os.environ[name] for name in SETTINGS if os.environ.get(name)}
    for name, value in given.items():
        is_lost = name == "OCIO" and "://" not in value and not Path(value).is_file()
        cure = "name a config that exists, or unset it" if is_lost else ""
        yield Line(name=name, found=value, cure=cure)
    if not given:
        yield Line(name="variables", found="none that changes what commands do")
