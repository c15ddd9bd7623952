"""Tests that `validate` finds what `render` stops at or complains of."""

from __future__ import annotations

import json

import pytest

from tests.products.mutated_stages import MUTATIONS, mutated
from usdsplat.core.findings import finding

pytestmark = pytest.mark.usefixtures("compiled")

FLAGS = ("--device", "cpu", "--frames", "1-2", "--json")
COUNT = 200


@pytest.mark.parametrize(
    "seed",
    [
        *range(COUNT),
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(COUNT, COUNT + 100)),
    ],
)
def test_whatever_render_says_validate_says(run, tmp_path, seed):
    """Oracle: the contract: code and path of each finding of `render` are among those of
    `validate`, and so is the sentence with which it stops. Every kind of mistake occurs alone or
    with others."""
    path = tmp_path / "shot.usda"
    names = mutated(path, seed)
    status, out, err = run("render", path, "-o", tmp_path / "a.####.exr", *FLAGS)
    _, told, complaint = run("validate", path, "--json")
    assert complaint == "", names
    findings = json.loads(told)["findings"]
    known = {(each["code"], each["path"]) for each in findings}
    if status:
        assert status == 2, (names, err)
        sentence = err.splitlines()[-1].removeprefix("usdsplat: ").partition(", expected ")[0]
        where, _, found = sentence.partition(": found ")
        stop = finding("bad-product", where, found, "")
        wrong = {(each["path"], each["attribute"], each["found"]) for each in findings}
        assert (stop.path, stop.attribute, stop.found) in wrong, (names, sentence)
    else:
        said = {(each["code"], each["path"]) for each in json.loads(out)["findings"]}
        assert said <= known, (names, said - known)


def test_every_mistake_is_made():
    """Oracle: the seeds of the contract go through the table several times."""
    assert len(MUTATIONS) * 3 < COUNT
