"""Write a job as an Open Job Description bundle, which farms such as Deadline Cloud take.

A bundle is a folder: `template.yaml`, which `openjd run` runs as it is; `parameter_values.yaml` and
`asset_references.yaml`, which a farm's submitter reads; and the inputs in `assets`.

Source: the Open Job Description specification 2023-09 with its extension TASK_CHUNKING, and the job
bundles of Deadline Cloud.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdsplat.core.errors import UsageError
from usdsplat.core.output import write_output
from usdsplat.core.wording import counted
from usdsplat.jobs.job import Job, Parameter, Slot, Step
from usdsplat.jobs.relights import PART

TEMPLATE, VALUES, REFERENCES = "template.yaml", "parameter_values.yaml", "asset_references.yaml"
ASSETS = "assets"
"""Folder of the inputs."""
OUTPUT, PROGRAM, FRAMES = "OutputFolder", "Program", "Frames"
"""Names of the parameters of all jobs, and that of the frames of pictures."""
MOST_VALUES = 1024
"""Maximum length of a list of values."""
_PICTURE = "--captured-hdri="
"""Flag whose value may be an input."""
_NAME = 128
"""Maximum length of the name of a job [character]."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """The parameter of a job that says where its inputs are."""

    name: str
    """Name of the parameter."""
    path: str
    """Default, in the folder of the bundle."""
    is_folder: bool
    """Whether it is a folder, in which all inputs are."""
    text: str
    """What it is, for users."""

    def word(self, inside: str = "") -> str:
        """Return the word of a command that stands for the input, or for a file in its folder."""
        return f"{_reference(self.name)}/{inside}" if self.is_folder else _reference(self.name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bundle:
    """What a bundle says beside the steps of its job."""

    folder: Path
    source: Source
    results: str
    """What is in the folder of the results, for users."""
    frames: Sequence[float] = ()
    """Time codes of pictures; empty for a job of other tasks."""
    chunk: int = 1
    """Frames of a task that draws."""
    inputs: tuple[str, ...] = ()
    """Absolute paths of files that are read where they lie."""


def write_bundle(job: Job, bundle: Bundle) -> list[Path]:
    """Write the files of a bundle whose inputs are in place, and return their paths, first the
    template.

    JSON is YAML, so the files are written as JSON.

    Raises:
        UsageError: If a name cannot be in a template.
        OutputError: If a file cannot be written.
    """
    template = template_of(job, bundle)
    assets = bundle.folder.absolute() / ASSETS
    inputs = [str(each) for each in sorted(assets.rglob("*")) if each.is_file()]
    inputs += bundle.inputs
    references = {
        "assetReferences": {
            "inputs": {"filenames": inputs, "directories": []},
            "outputs": {"directories": [str(bundle.folder.absolute() / "out")]},
            "referencedPaths": [],
        }
    }
    # submitters resolve the defaults of paths in the folder of the bundle, but not values
    values = [
        {"name": each["name"], "value": each["default"]}
        for each in template[_DEFINITIONS]
        if each["type"] != "PATH"
    ]
    texts = {
        TEMPLATE: template,
        VALUES: {"parameterValues": values},
        REFERENCES: references,
    }
    for name, value in texts.items():
        text = json.dumps(value, indent=2, ensure_ascii=False) + "\n"
        write_output(bundle.folder / name, text.encode("utf-8", "surrogateescape"))
    return [bundle.folder / name for name in texts]


_DEFINITIONS = "parameterDefinitions"


def template_of(job: Job, bundle: Bundle) -> dict[str, Any]:
    """Return the template of a job.

    Raises:
        UsageError: If a word of a command cannot be in a template.
    """
    source = bundle.source
    definitions: list[dict[str, Any]] = [
        {
            "name": source.name, "type": "PATH", "dataFlow": "IN",
            "objectType": "DIRECTORY" if source.is_folder else "FILE",
            "default": source.path, "description": source.text,
        },
        {
            "name": OUTPUT, "type": "PATH", "objectType": "DIRECTORY", "dataFlow": "OUT",
            "default": "out", "description": f"folder of the {bundle.results}",
        },
        {
            "name": PROGRAM, "type": "STRING", "default": "usdsplat",
            "description": "the program on the workers",
        },
    ]  # fmt: skip
    frames = _range(bundle.frames)
    if frames is not None:
        definitions.append(
            {
                "name": FRAMES, "type": "STRING", "default": frames,
                "description": "frames",
            }
        )  # fmt: skip
    return {
        "specificationVersion": "jobtemplate-2023-09",
        **({"extensions": ["TASK_CHUNKING"]} if frames else {}),
        "name": _job_name(job),
        _DEFINITIONS: definitions,
        "steps": [
            _step(each, bundle, is_range=frames is not None, memory=job.memory)
            for each in job.steps
        ],
    }


def _range(frames: Sequence[float]) -> str | None:
    """Return consecutive frames as a range; None if they are others, or none."""
    if not frames or not all(float(frame).is_integer() for frame in frames):
        return None
    first = frames[0]
    if list(frames) != [first + i for i in range(len(frames))]:
        return None
    return f"{first:.0f}-{frames[-1]:.0f}"


def _job_name(job: Job) -> str:
    """Return the name of a job in its template, where double braces would be references."""
    text = _CONTROL.sub("?", f"usdsplat {job.name}")
    return text.replace("{{", "((").replace("}}", "))")[:_NAME]


def _step(step: Step, bundle: Bundle, *, is_range: bool, memory: int | None) -> dict[str, Any]:
    """Return a step of the template."""
    program = _reference(PROGRAM)
    found: dict[str, Any] = {
        "name": step.name,
        "stepEnvironments": [
            {
                "name": "kernels",
                "script": {
                    "actions": {
                        "onEnter": {
                            "command": program,
                            "args": ["compile", "--device", "cuda" if step.uses_gpu else "cpu"],
                        }
                    }
                },
            }
        ],
        "script": {
            "actions": {
                "onRun": {
                    "command": program,
                    "args": [_argument(word, bundle.source) for word in step.command],
                }
            }
        },
    }
    if step.space:
        spaces = [_space(each, bundle, is_range=is_range) for each in step.space]
        found["parameterSpace"] = {"taskParameterDefinitions": spaces}
    if step.after:
        found["dependencies"] = [{"dependsOn": name} for name in step.after]
    amounts = []
    if step.uses_gpu:
        amounts.append({"name": "amount.worker.gpu", "min": 1})
    if memory is not None:
        amounts.append({"name": "amount.worker.memory", "min": max(1, memory >> 20)})
    if amounts:
        found["hostRequirements"] = {"amounts": amounts}
    return found


def _space(parameter: Parameter, bundle: Bundle, *, is_range: bool) -> Mapping[str, Any]:
    """Return the definition of a parameter of tasks."""
    name = _task_name(parameter.name)
    if name == FRAMES and is_range:
        chunks = {"defaultTaskCount": bundle.chunk, "rangeConstraint": "CONTIGUOUS"}
        return {"name": name, "type": "CHUNK[INT]", "range": _reference(FRAMES), "chunks": chunks}
    if len(parameter.values) > MOST_VALUES:
        is_chunk = parameter.name in (FRAMES.lower(), PART)
        found = counted(len(parameter.values), "task" if is_chunk else parameter.name)
        expected = f"at most {MOST_VALUES}{', by a larger --chunk' if is_chunk else ''}"
        raise UsageError("--openjd", f"{found} in a step", expected)
    return {"name": name, "type": "STRING", "range": list(parameter.values)}


def _task_name(name: str) -> str:
    return name.capitalize()


def _argument(word: str | Slot, source: Source) -> str:
    """Return a word of a command in the template.

    Raises:
        UsageError: If the word would be read as something else.
    """
    if isinstance(word, Slot):
        return f"{word.flag}={{{{Task.Param.{_task_name(word.parameter)}}}}}"
    rest = word.removeprefix(f"{_PICTURE}{source.word()}")  # with any other flag, it is a value
    rest = rest.removeprefix(source.word()).removeprefix("--output=")
    rest = rest.removeprefix(output_word(""))
    if "{{" in rest or "}}" in rest or _CONTROL.search(rest):
        raise UsageError("--openjd", repr(word), "a text without {{, }} and control characters")
    return word


def _reference(name: str) -> str:
    """Return the reference to a parameter of the job."""
    return f"{{{{Param.{name}}}}}"


def output_word(name: str) -> str:
    """Return the path of an output in the folder of the results.

    Args:
        name: Name of the file; for pictures with a placeholder for the frame.
    """
    return f"{_reference(OUTPUT)}/{name}"
