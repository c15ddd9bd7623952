"""Tests of how errors of libraries are explained."""

from __future__ import annotations

import logging

import pytest

from usdsplat.cli.failures import lacks_memory
from usdsplat.cli.main import main


def raised(*, is_hidden: bool) -> BaseException:
    """An error as Python raises it while another one, for lack of memory, is handled."""
    error = ValueError("a number")
    error.__context__, error.__suppress_context__ = MemoryError(), is_hidden
    return error


@pytest.mark.parametrize("is_hidden", [False, True])
def test_a_lack_of_memory_is_looked_for_where_python_would_show_it(is_hidden: bool) -> None:
    """Oracle: the rule of tracebacks: `from None` hides what came before."""
    assert lacks_memory(raised(is_hidden=is_hidden)) == (not is_hidden)


def test_commands_in_one_process_share_a_handler_of_log_records() -> None:
    """Oracle: the handlers of the logger."""
    for _ in range(3):
        assert main(["--version"]) == 0
    kinds = [type(each) for each in logging.getLogger("usdsplat").handlers]
    assert kinds.count(logging.NullHandler) <= 1
