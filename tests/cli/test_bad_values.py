"""Tests of stages with values that no schema allows: one bad prim does not stop a shot."""

from __future__ import annotations

import pytest

STAGE = """#usda 1.0
(
    upAxis = "{up}"
    metersPerUnit = 1
    renderSettingsPrimPath = "/Render/s"
)
def "Good" (references = @./shot.usda@</World/Ball>)
{{
}}
def Xform "Group"
{{
    {group}
    def "Bad" (references = @./shot.usda@</World/Ball>)
    {{
    }}
}}
def Camera "Cam" (references = @./shot.usda@</World/Cam>)
{{
    {camera}
}}
def Camera "Damaged"
{{
    float2 clippingRange = (nan, inf)
    matrix4d xformOp:transform = ((nan, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    uniform token[] xformOpOrder = ["xformOp:transform"]
}}
def DistantLight "Sun"
{{
    uniform token[] xformOpOrder = ["xformOp:bogus"]
}}
def Scope "Render"
{{
    def RenderSettings "s"
    {{
        rel camera = </Cam>
        uniform int2 resolution = (32, 24)
        uniform float4 dataWindowNDC = {window}
        rel products = </Render/s/p>
        def RenderProduct "p"
        {{
            token productName = "p.exr"
        }}
    }}
}}
"""
SOUND = {"up": "Y", "group": "", "camera": "", "window": "(0, 0, 1, 1)"}
OP = 'uniform token[] xformOpOrder = ["xformOp:wobble:x"]'
CASES = {
    "op": ({"group": OP}, "/Group.xformOpOrder: found ", True),
    "axis": ({"up": "X"}, "upAxis", False),
    "window": ({"window": "(nan, 0, 1, 1)"}, ".dataWindowNDC: found (nan, 0, 1, 1)", False),
}


def written(shot, **values):
    """A stage of two fields with these values."""
    path = shot.with_name(f"bad_{'_'.join(values)}.usda")
    path.write_text(STAGE.format(**{**SOUND, **values}))
    return path


@pytest.mark.parametrize(("values", "words", "loses"), CASES.values(), ids=CASES)
def test_a_bad_value_is_said_and_the_rest_is_drawn(values, words, loses, shot, run, tmp_path):
    """Oracle: status 0, a sentence on stderr, and a picture."""
    path, out = written(shot, **values), tmp_path / "a.exr"
    status, _, err = run("render", path, "-o", out, "--threads", "1")
    assert status == 0
    assert words in err
    assert "Traceback" not in err
    assert out.exists()
    status, told, err = run("convert", path, tmp_path / "a.ply")
    assert (status, err) == (0, "")
    assert ("600 splats" in told) == (not loses)
    assert ("left out: /Group.xformOpOrder" in told) == loses


@pytest.mark.parametrize(("values", "words", "_loses"), CASES.values(), ids=CASES)
def test_validate_finds_it(values, words, _loses, shot, run_json, run):
    """Oracle: status 1 and a finding that a sound stage does not have; the damaged camera and the
    light of both have theirs."""
    found = {}
    for name, with_values in (("sound", {}), ("bad", values)):
        status, out, _ = run("validate", written(shot, **with_values))
        assert status == 1
        found[name] = {line for line in out.splitlines() if line.startswith("error")}
        told = {line.split(":")[0] for line in found[name]}
        assert {"error [bad-camera] /Damaged", "error [bad-transform] /Sun.xformOpOrder"} <= told
    (new,) = found["bad"] - found["sound"]
    assert words in new


def test_a_camera_that_cannot_be_placed_is_one_sentence(shot, run, tmp_path):
    """Oracle: status 2 and the attribute's path; no picture."""
    path = written(shot, camera='uniform token[] xformOpOrder = ["xformOp:bogus"]')
    status, _, err = run("render", path, "-o", tmp_path / "a.exr")
    last = err.splitlines()[-1]
    assert status == 2
    assert last.startswith("usdsplat: /Cam.xformOpOrder: found 'xformOp:bogus', expected")
    assert not (tmp_path / "a.exr").exists()


@pytest.mark.parametrize("far", ["1e300", "1e39"])
def test_a_photograph_beyond_single_precision_is_refused(far, capture, run, tmp_path):
    """Oracle: status 2 and the name of the photograph; a stage with `inf` is not written."""
    folder, target = tmp_path / "cameras", tmp_path / "a.usda"
    folder.mkdir()
    (folder / "cameras.txt").write_text("1 PINHOLE 100 100 100 50 50 50\n")
    (folder / "images.txt").write_text(f"1 1 0 0 0 0 0 {far} 1 a.png\n\n")
    (folder / "points3D.txt").write_text("")
    status, out, err = run("convert", capture, target, "--cameras", folder)
    assert (status, out) == (2, "")
    assert "a.png: found numbers beyond the range of single precision" in err
    assert not target.exists()
