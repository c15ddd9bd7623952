"""Tests of `usdsplat worker`, to which another process sends commands."""

from __future__ import annotations

import json
import os
import subprocess
import sys


def answers(*lines):
    """What a worker prints for some lines of stdin, of text or bytes."""
    sent = [line if isinstance(line, bytes) else line.encode() for line in lines]
    done = subprocess.run(
        [sys.executable, "-m", "usdsplat", "worker"],
        input=b"".join(line + b"\n" for line in sent), capture_output=True, timeout=120,
        env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"")
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_each_line_has_an_answer_whatever_it_is():
    """Oracle: `usdsplat --version` before, between and after lines that are no commands."""
    good = json.dumps({"words": ["--version"]})
    deep = "[" * 200_000
    bad = ["nothing", "", "[]", '{"words": "render"}', '{"words": [1]}', "\u2028", b"\xff", deep]
    lines = [good, *(each for line in bad for each in (line, good))]
    found = answers(*lines)
    assert [each["status"] for each in found] == [0, *(2, 0) * len(bad)]
    assert all(each["out"].startswith("usdsplat ") for each in found[::2])
    for each in found[1::2]:
        assert each["err"].startswith("usdsplat: stdin: found ") and each["err"].count("\n") == 1


def test_a_worker_has_no_flags_of_its_own(run):
    """Oracle: the sentence: commands have their own."""
    for flag in ("--strict", "--quiet"):
        status, _, err = run("worker", flag)
        assert status == 2 and flag in err
