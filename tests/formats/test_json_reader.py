"""Tests of reading JSON piece by piece."""

from __future__ import annotations

import json
import random

import pytest

from usdsplat.core.errors import FormatError
from usdsplat.formats import json_reader
from usdsplat.formats.json_reader import TOO_LONG, JsonReader


def walked(reader):
    """The value that follows, read through its smallest pieces."""
    following = reader.next()
    if following == "{":
        return {key: walked(reader) for key in reader.items()}
    if following == "[":
        return [walked(reader) for _ in reader.elements()]
    return reader.value()


def made(rng, depth):
    """A random value."""
    if depth == 0 or rng.random() < 0.2:
        return rng.choice([None, True, 0, -12.5e-3, 10**20, "", 'a"\\ü\u2028', "x" * 700])
    if rng.random() < 0.5:
        return [made(rng, depth - 1) for _ in range(rng.randrange(4))]
    return {f"k{k} ": made(rng, depth - 1) for k in range(rng.randrange(4))}


@pytest.mark.parametrize("seed", range(20))
def test_pieces_together_are_the_value(seed):
    """Oracle: Python's parser."""
    rng = random.Random(seed)
    value = made(rng, 5)
    text = json.dumps(value, indent=rng.choice([None, 1]), ensure_ascii=seed % 2 == 0)
    for read in (walked, JsonReader.value):
        reader = JsonReader("x", f" {text}\n".encode())
        assert read(reader) == value
        reader.end()


@pytest.mark.parametrize(
    "text", [b"", b"{", b"[1", b"[1 2]", b"[,]", b'{"a" 1}', b'{"a":1,}', b"{1:2}", b"\xff", b"nul"]
)
def test_what_is_not_json_is_refused(text):
    """Oracle: Python's parser refuses it, too."""
    with pytest.raises(ValueError):
        json.loads(text)
    with pytest.raises(FormatError, match="x: found text that is not JSON"):
        walked(JsonReader("x", text))


def test_long_and_deep_values_are_refused():
    """Oracle: the limit of a value, which the number of its characters exceeds by one."""
    text = json.dumps("a" * 1000).encode()
    assert len(JsonReader("x", text + b" ").value(1003)) == 1000
    for wrong, longest in ((text + b" ", 1001), (b"[" * 60_000, 60_000)):
        with pytest.raises(FormatError, match="text that is not JSON"):
            JsonReader("x", wrong).value(longest)


def test_long_values_are_left_to_the_caller():
    """Oracle: what follows is still there, piece by piece."""
    text = json.dumps({"a": ["x" * 600, 2]}).encode()
    reader = JsonReader("x", text)
    assert reader.value_if_short(600) is TOO_LONG
    assert walked(reader) == json.loads(text)
    assert JsonReader("x", text).value_if_short() == json.loads(text)


def test_the_number_of_values_has_a_limit(monkeypatch):
    """Oracle: by hand: a key, a list of three numbers, and one more key, or one too few."""
    text = b'{"a": [1, 2, 3], "b\\n": {}}'
    for most, said in ((5, None), (4, "x: found more than 4 values, expected fewer")):
        monkeypatch.setattr(json_reader, "MOST", most)
        reader = JsonReader("x", text)
        if said is None:
            assert walked(reader) == {"a": [1, 2, 3], "b\n": {}}
            continue
        with pytest.raises(FormatError, match=said):
            walked(reader)


def test_more_text_is_refused():
    """Oracle: one value is all that a file has."""
    reader = JsonReader("x", b"1 2")
    assert reader.value() == 1
    with pytest.raises(FormatError, match="text that is not JSON"):
        reader.end()
