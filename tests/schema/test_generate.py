"""Tests that plugInfo/ is generated from the current schema.usda."""

from __future__ import annotations

import json

import pytest

from usdsplat.schema import generate
from usdsplat.schema.registration import plugin_folder
from usdsplat.schema.validation import VALIDATORS


@pytest.fixture(scope="module")
def generated() -> dict[str, str]:
    """What the generator makes now."""
    return generate.generate()


def test_the_committed_files_are_up_to_date(generated: dict[str, str]) -> None:
    """Oracle: USD's generator, run again."""
    for name, text in generated.items():
        assert (plugin_folder() / name).read_text(encoding="utf-8") == text, name


def test_usd_is_told_where_the_files_are_and_which_validators_there_are(generated) -> None:
    """Oracle: the format of plugInfo.json: plug-ins of one path hide each other."""
    schema, validators = json.loads(generated["plugInfo.json"])["Plugins"]
    assert (schema["Type"], schema["Root"], schema["ResourcePath"]) == ("resource", ".", ".")
    assert validators["Type"] == "python"
    assert validators["Root"] != schema["Root"]
    assert set(validators["Info"]["Validators"]) == {*VALIDATORS, "keywords"}
    assert "@" not in generated["plugInfo.json"]


def test_check_says_what_is_stale_and_writes_nothing(generated, tmp_path, monkeypatch, capsys):
    """Oracle: a folder with one stale file; the status is that of a failing check."""
    monkeypatch.setattr(generate, "generate", lambda: generated)
    monkeypatch.setattr(generate, "plugin_folder", lambda: tmp_path)
    (tmp_path / "plugInfo.json").write_text(generated["plugInfo.json"], encoding="utf-8")
    assert generate.main(["--check"]) == 1
    assert capsys.readouterr().out == f"{tmp_path / 'generatedSchema.usda'}: stale\n"
    assert generate.main([]) == 0
    assert generate.main(["--check"]) == 0
