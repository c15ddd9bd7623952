"""Tests of processes that are forked; each is forked from a process without threads."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks on Linux only")

BEGIN = """
import os, signal, subprocess, sys, time
from usdsplat.jobs.forked import ForkedProcess
"""


def printed(code):
    """What a program prints, line by line."""
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + code],
        capture_output=True, text=True, timeout=60, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


def test_it_talks_through_its_pipes_and_has_its_variables_and_status():
    """Oracle: by hand. What waits in the buffer of stdout is written once."""
    found = printed("""
def run():
    print(sys.stdin.readline().upper().strip(), os.environ["A"], file=sys.stderr)
    return 3
print("before", end=" ")
made = ForkedProcess(run, {"A": "b"})
made.stdin.write("text\\n")
made.stdin.flush()
print(made.stdout.read().strip(), made.wait(30), made.poll(), "A" in os.environ)
""")
    assert found == ["before TEXT b 3 3 False"]


def test_it_has_no_file_of_the_process_that_forked_it():
    """Oracle: its stdin ends with that process, whatever was forked after it."""
    found = printed("""
def run():
    return len(sys.stdin.read())
first = ForkedProcess(run, {})
second = ForkedProcess(lambda: print("begun", flush=True) or time.sleep(60) or 0, {})
second.stdout.readline()
first.stdin.close()
print(first.wait(30), os.getsid(second.pid) == second.pid, second.poll())
second.kill()
print(second.wait(30) == -signal.SIGKILL)
""")
    assert found == ["0 True None", "True"]


def test_an_exception_is_told_and_waiting_ends():
    """Oracle: the traceback in what it prints, its status, and the exception of `subprocess`."""
    found = printed("""
made = ForkedProcess(lambda: 1 // 0, {})
text = made.stdout.read()
print("ZeroDivisionError" in text, made.wait(30))
made = ForkedProcess(lambda: time.sleep(60) or 0, {})
try:
    made.wait(0.05)
except subprocess.TimeoutExpired:
    made.kill()
    print("late")
""")
    assert found == ["True 1", "late"]


def test_a_signal_does_not_raise_in_it_before_it_begins():
    """Oracle: the mask of signals of each: the new process has that of the old one."""
    found = printed("""
def run():
    print(sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ())), flush=True)
    return 0
signal.pthread_sigmask(signal.SIG_SETMASK, {signal.SIGHUP})
made = ForkedProcess(run, {})
print(made.stdout.read().strip(), made.wait(30))
print(sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ())))
""")
    assert found[0] == f"{found[1]} 0" and "SIGHUP" in found[1]


def test_its_end_is_known_where_nobody_keeps_a_status():
    """Oracle: `subprocess`, whose processes count as ended with 0 then."""
    found = printed("""
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
made = ForkedProcess(lambda: 3, {})
made.stdout.read()
print(made.wait(30))
""")
    assert found == ["0"]
