"""Tests of our plug-in in usdview, with the results of one run of `drive`."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from usdsplat.cli.main import main

pytest.importorskip("PySide6.QtWidgets", exc_type=ImportError)


@pytest.fixture(scope="module")
def facts(tmp_path_factory):
    """What `drive` wrote down, found by the folders that `plugin-path` prints."""
    folder = tmp_path_factory.mktemp("usdview")
    with pytest.MonkeyPatch.context() as patch:
        said = folder / "path.txt"
        with said.open("w") as file:
            patch.setattr(sys, "stdout", file)
            assert main(["plugin-path"]) == 0
    environment = {**os.environ, "PXR_PLUGINPATH_NAME": said.read_text().strip()}
    command = [sys.executable, "-m", "tests.preview.usdview.drive", str(folder)]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return {**json.loads((folder / "facts.json").read_text()), "stderr": run.stderr}


def test_usdview_finds_the_plugin_and_has_its_menu(facts):
    """Oracle: the commands of the issue; Plug loads the real plugInfo.json and container."""
    assert [*facts["menu"]] == [
        "Splat Viewport",
        "Simulation",
        "Render Settings",
        "Probe",
        "Follow usdview's Camera",
    ]
    assert all(facts["menu"].values())


def test_nothing_heavy_is_loaded_at_usdviews_start(facts):
    """Oracle: the modules, before anything was chosen from the menu."""
    assert facts["loaded at start"] is False


def test_the_viewport_draws_usdviews_stage_and_follows_it(facts):
    """Oracle: pictures of the frame, the selection and the camera that usdview has."""
    assert facts["first picture"]
    assert facts["docks after opening twice"] == ["Splat Viewport"]
    assert facts["follows the frame"]
    assert facts["follows the selection"]
    assert facts["follows the camera"]


def test_edits_of_the_stage_show_and_a_pick_is_usdviews_selection(facts):
    """Oracle: another picture after a field was hidden; the path of the one that is left."""
    assert facts["edits show"]
    assert facts["picked"] == ["/World/A"]


def test_the_viewports_letters_are_no_shortcuts_of_usdview(facts):
    """Oracle: F frames where the pointer is, and usdview's own action with that key is quiet."""
    assert facts["F frames in ours"]
    assert facts["F went to usdview"] == []


def test_a_stage_that_is_replaced_is_let_go_and_the_next_one_shown(facts):
    """Oracle: no viewport without a stage, and another one afterwards."""
    assert facts["empty without a stage"]
    assert facts["the next stage"]
    assert facts["another viewport"]


def test_a_simulation_runs_on_usdviews_stage_and_leaves_nothing_behind(facts):
    """Oracle: pictures of simulated frames; the root layer is clean, and the session layer has no
    sublayer of ours once the docks are closed."""
    assert facts["docks"] == [
        "Splat Probe",
        "Splat Render Settings",
        "Splat Simulation",
        "Splat Viewport",
    ]
    assert facts["it runs"]
    assert facts["state"] == "running"
    assert facts["root layer is dirty"] is False
    assert facts["sublayers left"] == []


def test_closed_docks_hold_nothing_and_open_again(facts):
    """Oracle: no viewport while they are closed, and a picture when one is opened."""
    assert facts["nothing after closing"]
    assert facts["opened again"]


def test_another_qt_is_refused_in_one_sentence(facts):
    """Oracle: where: found X, expected Y in the status bar and on stderr; nothing else there but
    what the screenless platform itself has to say."""
    sentence = "usdsplat: usdview: found a usdview with PySide2, expected one that was built"
    assert [line for line in facts["with PySide2"] if line.startswith(sentence)]
    words = [line for line in facts["stderr"].splitlines() if "propagateSizeHints" not in line]
    assert len(words) == 1
    assert words[0].startswith(sentence)
