"""Tests of the error classes."""

from __future__ import annotations

import pickle

import pytest

from usdsplat.core import errors

FAMILY = {
    errors.FormatError: ValueError,
    errors.UnknownFormatError: LookupError,
    errors.StageError: ValueError,
    errors.SchemaUnavailableError: RuntimeError,
    errors.BackendError: RuntimeError,
    errors.UsageError: ValueError,
    errors.OutputError: OSError,
    errors.EarlierFilesError: OSError,
}


@pytest.mark.parametrize(("cls", "builtin"), FAMILY.items())
def test_each_error_is_one_sentence_a_builtin_and_survives_another_process(
    cls: type, builtin: type
) -> None:
    """Oracle: the sentence's shape, the class a Python programmer would catch, and pickle."""
    error = cls("a.ply", "33 bytes", "a multiple of 32")
    assert isinstance(error, errors.UsdSplatError) and isinstance(error, builtin)
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error) == "a.ply: found 33 bytes, expected a multiple of 32"
    assert (copy.where, copy.found, copy.expected) == ("a.ply", "33 bytes", "a multiple of 32")
