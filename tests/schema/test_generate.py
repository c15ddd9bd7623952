"""Tests that the plug-ins are generated from the current schema.usda and checks."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from usdsplat.schema import generate
from usdsplat.schema.registration import VALIDATORS_NAME, plugin_folder, validators_folder
from usdsplat.schema.validation import VALIDATORS


@pytest.fixture(scope="module")
def generated() -> dict[Path, str]:
    """What the generator makes now."""
    return generate.generate()


def test_the_committed_files_are_up_to_date(generated: dict[Path, str]) -> None:
    """Oracle: USD's generator, run again."""
    for path, text in generated.items():
        assert path.read_text(encoding="utf-8") == text, path


def test_the_schemas_are_a_plugin_without_code(generated) -> None:
    """Oracle: the format of plugInfo.json: only "resource" plug-ins load nothing."""
    text = generated[plugin_folder() / "plugInfo.json"]
    (schema,) = json.loads(text)["Plugins"]
    assert (schema["Type"], schema["Root"], schema["ResourcePath"]) == ("resource", ".", ".")
    assert schema["LibraryPath"] == "" and "@" not in text


def test_the_validators_are_a_plugin_in_a_folder_of_their_own(generated) -> None:
    """Oracle: the table of checks."""
    (plugin,) = json.loads(generated[validators_folder() / "plugInfo.json"])["Plugins"]
    assert (plugin["Type"], plugin["Name"]) == ("python", VALIDATORS_NAME)
    assert set(plugin["Info"]["Validators"]) == {*VALIDATORS, "keywords"}


def test_check_says_what_is_stale_and_writes_nothing(generated, tmp_path, monkeypatch, capsys):
    """Oracle: a folder with one stale file; the status is that of a failing check."""
    schema, plugin, _ = generated.values()
    texts = {tmp_path / "generatedSchema.usda": schema, tmp_path / "b.json": plugin}
    monkeypatch.setattr(generate, "generate", lambda: texts)
    (tmp_path / "b.json").write_text(texts[tmp_path / "b.json"], encoding="utf-8")
    assert generate.main(["--check"]) == 1
    assert capsys.readouterr().out == f"{tmp_path / 'generatedSchema.usda'}: stale\n"
    assert generate.main([]) == 0
    assert generate.main(["--check"]) == 0
