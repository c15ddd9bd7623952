"""Tests that commands report what a stage asks for and does not get, and of --strict, -q and -v."""

from __future__ import annotations

import json
import warnings

import pytest
from pxr import Sdf, Tf, Usd, UsdGeom

from tests.products.mutated_stages import MUTATIONS, base
from usdsplat.cli.reporting import Reporter, ReportingOptions, reported
from usdsplat.sim.stage.authoring import author

pytestmark = pytest.mark.usefixtures("compiled")

EXPECTED = {
    "reference": ("missing-asset", "/W/Hero"),
    "prim": ("missing-prim", "/W/Hero2"),
    "sublayer": ("missing-asset", "/"),
    "texture": ("missing-asset", "/W/Mat/T"),
    "dome": ("bad-light", "/W/Dome"),
    "bright": ("extreme-light", "/W/Sun"),
    "portal": ("unsupported-light", "/W/Portal"),
    "volume": ("unsupported-prim", "/W/Volume"),
    "curves": ("unsupported-prim", "/W/Hair"),
    "typing error": ("unknown-type", "/W/Typo"),
    "opacity": ("unsupported-input", "/W/Mat/S"),
    "metallic": ("unsupported-input", "/W/Mat/S"),
    "emission": ("unsupported-input", "/W/Mat/S"),
    "input": ("unknown-name", "/W/Mat/S"),
    "surface": ("unsupported-surface", "/W/Mat/S"),
    "grade": ("unknown-name", "/W/Ball"),
    "samples": ("unknown-name", "/Render/Settings"),
    "crop": ("missing-prim", "/W/Ball"),
    "instancer": ("bad-instancer", "/W/Scatter"),
    "op": ("bad-transform", "/W/Floor"),
    "later indices": ("not-drawn", "/W/Floor"),
    "space": ("not-drawn", "/W/Ball"),
}
"""Mistake -> code and path of its finding."""

STOPS = {
    "clipping": ("bad-camera", "/W/Cam"),
    "resolution": ("bad-product", "/Render/Settings"),
    "camera": ("bad-product", "/Render/Product"),
    "product": ("bad-product", "/Render/Settings"),
    "no var": ("bad-product", "/Render/Product"),
    "kind": ("bad-product", "/Render/Product"),
}
"""Mistake at which `render` stops -> the same."""


@pytest.fixture
def make(tmp_path):
    """Write a stage with a mistake, and return its file."""

    def write(*names):
        stage = base(tmp_path / "stage.usda")
        for name in names:
            MUTATIONS[name](stage)
        stage.GetRootLayer().Save()
        return tmp_path / "stage.usda"

    return write


@pytest.fixture
def rendered(run, tmp_path):
    """Render two frames of a stage; returns status, findings and stderr."""

    def command(path, *flags):
        output = ("-o", tmp_path / "out" / "a.%d.exr", "--frames", "1-2", "--device", "cpu")
        (tmp_path / "out").mkdir(exist_ok=True)
        status, out, err = run("render", path, *output, "--json", *flags)
        return status, json.loads(out)["findings"] if out else [], err

    return command


def keys(findings):
    """Code and path of each finding."""
    return [(each["code"], each["path"]) for each in findings]


def test_a_stage_without_mistakes_has_no_finding(make, rendered, run_json):
    """Oracle: the base of all mistakes."""
    assert rendered(make(), "--strict") == (0, [], "")
    assert run_json("validate", make(), "--strict")["findings"] == []


@pytest.mark.parametrize("name", EXPECTED)
def test_a_mistake_is_a_finding_of_render_and_of_validate(make, rendered, run, name):
    """Oracle: the mistake made here; once on stderr, in --json, and in the same words by
    `validate`. With --strict the status is 1 and no file is written."""
    path = make(name)
    status, findings, err = rendered(path)
    assert (status, keys(findings)) == (0, [EXPECTED[name]])
    (line,) = err.splitlines()
    severity, code = findings[0]["severity"], findings[0]["code"]
    assert line.startswith(f"usdsplat: {severity} [{code}] {findings[0]['path']}")
    status, out, _ = run("validate", path)
    assert line.removeprefix("usdsplat: ") in out.splitlines()
    assert status == (severity == "error")
    assert run("validate", path, "--strict")[0] == 1
    for file in path.parent.glob("out/*"):
        file.unlink()
    status, findings, err = rendered(path, "--strict")
    assert (status, keys(findings)) == (1, [EXPECTED[name]])
    assert err.splitlines()[-1].startswith("usdsplat: --strict: found 1 ")
    assert list(path.parent.glob("out/*")) == []


@pytest.mark.parametrize("name", STOPS)
def test_validate_finds_what_render_stops_at(make, rendered, run, name):
    """Oracle: the mistake made here, and the sentence of `render`."""
    path = make(name)
    status, _, err = rendered(path)
    assert status == 2
    status, out, _ = run("validate", path, "--json")
    found = json.loads(out)["findings"]
    assert status == 1 and STOPS[name] in keys(found)
    assert any(each["found"] in err for each in found)


def test_a_mistake_that_begins_later_is_told_with_its_frame(make, rendered):
    """Oracle: frame 2, where the faces become wrong."""
    _, (found,), err = rendered(make("later indices"))
    assert found["time"] == 2.0
    assert "usdsplat: error [not-drawn] /W/Floor at 2: found face vertex index 9" in err


def test_a_wide_lens_is_a_finding_if_it_blurs(make, rendered, run):
    """Oracle: a lens 7.5 units wide, focused at 4 units: more than a tenth."""
    stage = Usd.Stage.Open(str(make()))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/W/Cam"))
    camera.GetFocalLengthAttr().Set(30.0)
    camera.GetFStopAttr().Set(0.4)
    camera.GetFocusDistanceAttr().Set(4.0)
    stage.GetRootLayer().Save()
    path = stage.GetRootLayer().realPath
    assert ("wide-lens", "/W/Cam") in keys(rendered(path, "--samples", 2)[1])
    assert keys(rendered(path)[1]) == [("no-blur", "/W/Cam")]
    assert "warning [wide-lens] /W/Cam: found a lens 7.5 wide" in run("validate", path)[1]


def test_every_empty_crop_member_is_told(make, rendered):
    """Oracle: two members that cannot crop, and a prim that does not exist."""
    stage = Usd.Stage.Open(str(make()))
    UsdGeom.Mesh.Define(stage, "/W/Other")
    includes = stage.GetPrimAtPath("/W/Ball").CreateRelationship("collection:cropInclude:includes")
    includes.SetTargets(["/W/Floor", "/W/Other", "/W/None"])
    stage.GetRootLayer().Save()
    codes = [code for code, path in keys(rendered(stage.GetRootLayer().realPath)[1])]
    assert sorted(codes) == ["crop-member", "crop-member", "empty-crop", "missing-prim"]


def test_nothing_to_check_and_nothing_to_draw_are_findings(run, tmp_path):
    """Oracle: a stage without a prim; how much was looked at is zero."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    stage.GetRootLayer().Save()
    status, out, _ = run("validate", tmp_path / "a.usda", "--json")
    told = json.loads(out)
    assert status == 0
    assert keys(told["findings"]) == [("nothing-to-draw", "/"), ("nothing-checked", "/")]
    assert "fields" not in told["looked_at"] and told["looked_at"]["files"] == 1


def test_many_stages_are_validated_and_each_finding_has_its_file(make, run, capture, tmp_path):
    """Oracle: one good stage, one with a mistake, a capture and a missing file."""
    path = make("grade")
    good = base(tmp_path / "good.usda")
    good.GetRootLayer().Save()
    files = [tmp_path / "good.usda", path, capture, tmp_path / "no.usda"]
    status, out, _ = run("validate", *files, "--json")
    told = json.loads(out)
    assert status == 1 and told["looked_at"]["files"] == 4 and told["looked_at"]["fields"] == 2
    found = [(each["code"], each["file"]) for each in told["findings"]]
    assert found == [
        ("unknown-name", str(path)),
        ("unreadable", str(capture)),
        ("unreadable", str(files[3])),
    ]
    assert "usdsplat convert makes one" in told["findings"][1]["expected"]
    assert run("validate", *files)[1].splitlines()[-1] == "4 files: 2 errors, 1 warning"


def test_the_only_file_that_cannot_be_read_is_a_finding_in_json(run, tmp_path):
    """Oracle: the object of --json; without it, one sentence and status 2."""
    status, out, err = run("validate", tmp_path / "no.usda", "--json")
    (found,) = json.loads(out)["findings"]
    assert (status, err) == (1, "")
    assert (found["code"], found["path"]) == ("unreadable", str(tmp_path / "no.usda"))
    status, out, err = run("validate", tmp_path / "no.usda")
    assert (status, out, err.count("\n")) == (2, "", 1)


def test_simulate_and_convert_report_the_same_finding(make, run, tmp_path):
    """Oracle: a missing reference, and --json of each command; with --strict no file is written."""
    path = make("reference")
    stage = Usd.Stage.Open(str(path))
    author(stage.DefinePrim("/W/Sim", "SplatSim"), {"settle:omega": 2.0})
    stage.GetRootLayer().Save()
    commands = {
        "simulate": ("-o", tmp_path / "simulate.usda", "--frames", "1:2"),
        "convert": (tmp_path / "convert.usda", "--packed"),
        "info": (),
    }
    for name, words in commands.items():
        status, out, err = run(name, path, *words, "--strict", "--json")
        assert (status, keys(json.loads(out)["findings"])) == (1, [("missing-asset", "/W/Hero")])
        assert not (tmp_path / f"{name}.usda").exists()
        status, out, err = run(name, path, *words, "--json")
        assert (status, keys(json.loads(out)["findings"])) == (0, [("missing-asset", "/W/Hero")])
        assert err.count("[missing-asset]") == 1


def test_a_strict_window_does_not_open(make, run, monkeypatch):
    """Oracle: status 1 before anything is served."""
    monkeypatch.setattr("usdsplat.cli.view._serve", lambda *_: pytest.fail("served"))
    status, _, err = run("view", make("portal"), "--web", "--strict")
    assert status == 1 and "warning [unsupported-light] /W/Portal" in err


def test_quiet_keeps_errors_and_verbose_adds_cures(make, rendered):
    """Oracle: a warning and an error."""
    path = make("portal", "reference")
    (line,) = rendered(path, "-q")[2].splitlines()
    assert line.startswith("usdsplat: error [missing-asset]")
    lines = rendered(path, "--verbose")[2].splitlines()
    assert (
        "  cure: use distant, sphere, disk, rect, cylinder or dome lights, or hide the light"
        in lines
    )
    assert "  cure: restore the file, or correct the asset path" in lines


class Warned:
    """A command at which USD and Python warn."""

    def run(self, options, reporter):
        """Warn."""
        Tf.Warn("odd stage")
        warnings.warn("odd number", RuntimeWarning, stacklevel=1)
        return 0


class Options:
    """Options of `Warned`."""

    def __init__(self, **reporting):
        self.reporting = ReportingOptions(**reporting)


def test_messages_of_libraries_are_notes_that_only_verbose_prints(capfd):
    """Oracle: a warning of each; neither USD nor Python prints it, and --strict ignores notes."""
    assert reported(Warned(), Options(strict=True)) == 0
    assert capfd.readouterr() == ("", "")
    assert reported(Warned(), Options(verbose=True)) == 0
    err = capfd.readouterr().err
    assert "usdsplat: note [usd-message] USD: found odd stage, expected no message" in err
    assert "RuntimeWarning: odd number" in err


class Printed(Warned):
    """A command that prints JSON, and warns before and after."""

    def run(self, options, reporter):
        """Warn, report, and warn again."""
        Tf.Warn("early stage")
        reporter.print_json({"value": 1})
        return super().run(options, reporter)


def test_json_has_the_messages_of_libraries(capfd):
    """Oracle: warnings of USD before and after the command's report, and one of Python."""
    assert reported(Printed(), Options()) == 0
    printed = json.loads(capfd.readouterr().out)
    assert printed["value"] == 1
    found = [each["found"] for each in printed["findings"]]
    assert [text.split()[-2:] for text in found[:2]] == [["early", "stage"], ["odd", "stage"]]
    assert found[2:] == ["RuntimeWarning: odd number"]


def test_validate_has_the_messages_of_libraries_in_json(make, run_json, monkeypatch):
    """Oracle: a warning of USD while a stage is checked, and a mistake."""
    from usdsplat.products import checking

    check = checking.check_stage

    def warned(*args, **options):
        Tf.Warn("odd stage")
        return check(*args, **options)

    monkeypatch.setattr(checking, "check_stage", warned)
    found = run_json("validate", make("portal"))["findings"]
    assert [each["code"] for each in found] == ["unsupported-light", "usd-message"]


@pytest.mark.parametrize(
    ("command", "mistakes"),
    [
        ("info", ("texture", "dome", "reference", "input")),
        ("convert", ("portal", "reference", "grade", "crop", "instancer")),
    ],
)
def test_what_is_missing_is_a_finding_of_info_and_convert(
    make, run, rendered, tmp_path, command, mistakes
):
    """Oracle: the mistakes made here, and the words of `render`; --strict writes nothing. `convert`
    reports what costs no splat data."""
    path = make(*mistakes)
    target = () if command == "info" else (tmp_path / "out.ply",)
    status, out, err = run(command, path, *target, "--json")
    assert status == 0
    assert set(keys(json.loads(out)["findings"])) == {EXPECTED[name] for name in mistakes}
    told, expected = (
        sorted(line for line in text.splitlines() if " [" in line)
        for text in (err, rendered(path)[2])
    )
    assert told == expected and len(told) == len(mistakes)
    for file in target:
        file.unlink()
    assert run(command, path, *target, "--strict")[0] == 1
    assert not any(file.exists() for file in target)


def test_a_reporter_says_nothing_of_progress_if_it_is_quiet(capsys):
    """Oracle: stderr."""
    for quiet in (True, False):
        reporter = Reporter(ReportingOptions(quiet=quiet))
        reporter.remark("a remark")
        reporter.announce_compilation("compiling")("kernel")
        with reporter.progress() as progress:
            progress.step("work", 0, 1)
        assert bool(capsys.readouterr().err) != quiet


def test_a_name_that_is_misspelt_while_a_stage_is_open_is_found(make):
    """Oracle: the findings of an engine before and after the name is authored and removed."""
    from usdsplat.delegate.engine import Engine

    stage = Usd.Stage.Open(str(make()))
    prim = stage.GetPrimAtPath("/W/Ball")
    with Engine(stage, time=1.0) as engine:
        assert engine.findings == ()
        prim.CreateAttribute("splat:grade:exposre", Sdf.ValueTypeNames.Float).Set(1.0)
        (found,) = engine.findings
        assert (found.code, found.attribute) == ("unknown-name", "splat:grade:exposre")
        prim.RemoveProperty("splat:grade:exposre")
        assert engine.findings == ()
