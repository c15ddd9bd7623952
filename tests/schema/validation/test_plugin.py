"""Tests of the checks as validators of UsdValidation, also in a process that did not import our
package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Usd, UsdValidation, Vt

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.schema.registration import plugin_folder, takes_validators, validators_folder
from usdsplat.schema.validation import CHECKS, TREES, VALIDATORS

pytestmark = pytest.mark.skipif(not takes_validators(), reason="USD takes validators since 26.5")
PREFIX = "usdsplat.schema.validation.plugin:"


def errors(stage: Usd.Stage, *names: str) -> list[UsdValidation.ValidationError]:
    """What our validators say about a stage."""
    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadValidatorsByName([PREFIX + name for name in names])
    return UsdValidation.ValidationContext(validators).Validate(stage)


def test_there_is_a_validator_for_each_group_of_checks() -> None:
    """Oracle: USD's registry."""
    registry = UsdValidation.ValidationRegistry()
    listed = registry.GetValidatorMetadataForKeyword("usdsplat")
    assert {item.name for item in listed} == {PREFIX + name for name in VALIDATORS}
    assert {*CHECKS, TREES} == set(VALIDATORS)
    assert all(item.isTimeDependent and item.doc for item in listed)


@pytest.mark.parametrize("form", ["float", "packed"])
def test_a_sound_field_has_no_errors(stage: Usd.Stage, form: str) -> None:
    """Oracle: the validators run by USD."""
    schema.author(stage, "/Splats", cloud(n=20), form=form)
    assert errors(stage, *VALIDATORS) == []


def test_findings_arrive_with_site_severity_and_cure(stage: Usd.Stage) -> None:
    """Oracle: what `validate` says about the same stage."""
    prim = schema.author(stage, "/Splats", cloud(n=20))
    prim.GetAttribute("opacities").Set(Vt.FloatArray([2] * 20))
    prim.RemoveProperty("colorSpace:name")
    range_error, space_error = errors(stage, "SplatArrays", "SplatRadiance")
    if range_error.GetName() != "opacityRange":
        range_error, space_error = space_error, range_error
    finding = next(f for f in schema.validate(stage) if f.code == "opacity-range")
    assert range_error.GetMessage() == f"{finding.message}; {finding.cure} (rule VG.035)"
    assert range_error.GetType() == UsdValidation.ValidationErrorType.Error
    assert range_error.GetSites()[0].GetProperty() == prim.GetAttribute("opacities")
    assert space_error.GetType() == UsdValidation.ValidationErrorType.Warn
    assert space_error.GetSites()[0].GetProperty() == prim.GetAttribute("colorSpace:name")


def test_only_samples_within_the_asked_times_are_checked(stage: Usd.Stage) -> None:
    """Oracle: a fault at time 5 and none at time 1."""
    prim = schema.author(stage, "/Splats", cloud(1, n=2), time=1)
    schema.author(stage, "/Splats", cloud(2, n=2), time=5)
    prim.GetAttribute("opacities").Set(Vt.FloatArray([2, 2]), 5)
    validator = UsdValidation.ValidationRegistry().GetOrLoadValidatorByName(PREFIX + "SplatArrays")

    def count(time: float) -> int:
        return len(validator.Validate(prim, UsdValidation.ValidationTimeRange(Usd.TimeCode(time))))

    assert (count(1), count(5)) == (0, 1)


def test_another_process_discovers_and_runs_them(stage: Usd.Stage, tmp_path: Path) -> None:
    """Oracle: a process with both folders in PXR_PLUGINPATH_NAME that imports nothing of ours."""
    prim = schema.author(stage, "/Splats", cloud(n=20), form="packed")
    prim.GetAttribute("splat:packing").Set("other_v1")
    path = tmp_path / "bad.usdc"
    stage.Export(str(path))
    code = f"""
import sys
from pxr import Usd, UsdValidation
registry = UsdValidation.ValidationRegistry()
names = [m.name for m in registry.GetAllValidatorMetadata() if m.name.startswith("usdsplat")]
assert len(names) == {len(VALIDATORS)} and "usdsplat" not in sys.modules
context = UsdValidation.ValidationContext(registry.GetOrLoadValidatorsByName(names))
print([error.GetName() for error in context.Validate(Usd.Stage.Open({str(path)!r}))])
"""
    folders = os.pathsep.join(map(str, (plugin_folder(), validators_folder())))
    environment = {**os.environ, "PXR_PLUGINPATH_NAME": folders}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == "['unknownPacking']"


def test_a_python_without_our_package_loads_all_validators(tmp_path: Path) -> None:
    """Oracle: `GetOrLoadAllValidators`, in a process in which our package cannot be imported.

    It raises if any plug-in on the path fails to load.
    """
    code = """
import sys

class Without:
    def find_spec(self, name, *_):
        if name.split(".")[0] == "usdsplat":
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Without())
from pxr import Usd, UsdValidation
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
known = Usd.SchemaRegistry().FindConcretePrimDefinition("ParticleFieldPackedSplat") is not None
print(len(validators) > 0, known)
"""

    def run(*folders: Path) -> subprocess.CompletedProcess[str]:
        path = os.pathsep.join(map(str, folders))
        return subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            env={**os.environ, "PXR_PLUGINPATH_NAME": path},
            cwd=tmp_path,
            check=False,
        )

    done = run(plugin_folder())
    assert (done.returncode, done.stderr, done.stdout.strip()) == (0, "", "True True")
    assert "ErrorException" in run(plugin_folder(), validators_folder()).stderr


@pytest.mark.parametrize(("form", "degree"), [("half", 1), ("float", 4)])
def test_a_form_that_the_user_chose_is_no_fault(stage: Usd.Stage, form: str, degree: int) -> None:
    """Oracle: `validate`, which has a warning that USD's validators do not have."""
    schema.author(stage, "/Splats", cloud(n=2, degree=degree), form=form)
    assert [finding.severity for finding in schema.validate(stage)] == ["warning"]
    assert errors(stage, *VALIDATORS) == []
