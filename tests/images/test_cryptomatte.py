"""Tests of Cryptomatte hashes and header entries."""

from __future__ import annotations

import json
import math
import struct

import numpy as np
import pytest

from usdsplat.images.cryptomatte import hash_bits, metadata, murmur3, object_hash


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", 0),
        (b"\xff\xff\xff\xff", 0x76293B50),
        (b"\x21\x43\x65\x87", 0xF55B516B),
        (b"\x21\x43\x65", 0x7E4A8634),
        (b"\x21\x43", 0xA0F7B07A),
        (b"\x21", 0x72661CF4),
        (b"\0\0\0\0", 0x2362F9DE),
        (b"\0", 0x514E28B7),
    ],
)
def test_bytes_are_hashed_by_murmur3(data, expected):
    """Oracle: the published test vectors of MurmurHash3_x86_32, seed 0; every length of tail."""
    assert murmur3(data) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hello", 6.0705627102400005616e-17),
        ("cube", -4.08461912519e15),
        ("sphere", 2.79018604383e15),
        ("plane", 3.66557617593e-11),
    ],
)
def test_names_become_the_floats_of_the_specification(name, expected):
    """Oracle: the test values that the Cryptomatte specification gives."""
    assert float(object_hash(name)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "raw"),
    [
        ("/World/prim_293", 0x7FDFF476),
        ("/World/prim_590", 0x80054E2C),
        ("/World/prim_1073", 0x003C8E6B),
        ("/World/prim_1111", 0x8077A7C9),
    ],
)
def test_a_hash_that_is_no_normal_number_has_one_bit_turned(name, raw):
    """Oracle: hashes made by mmh3 5.3, whose exponents are 0 or 255, and IEEE 754."""
    assert murmur3(name.encode()) == raw
    assert hash_bits(name) == raw ^ 0x00800000
    value = float(object_hash(name))
    assert math.isfinite(value)
    assert abs(value) >= np.finfo(np.float32).tiny


def test_names_are_hashed_as_utf_8():
    """Oracle: mmh3 5.3 of the UTF-8 bytes of the name."""
    assert hash_bits("/a/bé") == 0xD731C072


def test_the_header_says_how_to_find_a_name():
    """Oracle: the keys of the Cryptomatte specification 1.2; each hex is the bits in the pixels."""
    entries = metadata("cryptoObject", ["/World/Garden", '/World/a "b"', "/World/prim_293"])
    (prefix,) = {key.rpartition("/")[0] for key in entries}
    assert prefix == f"cryptomatte/{hash_bits('cryptoObject'):08x}"[: len("cryptomatte/") + 7]
    assert entries[f"{prefix}/name"] == "cryptoObject"
    assert entries[f"{prefix}/hash"] == "MurmurHash3_32"
    assert entries[f"{prefix}/conversion"] == "uint32_to_float32"
    manifest = json.loads(entries[f"{prefix}/manifest"])
    assert list(manifest) == ["/World/Garden", '/World/a "b"', "/World/prim_293"]
    for name, text in manifest.items():
        assert struct.pack("<f", object_hash(name)) == bytes.fromhex(text)[::-1]
