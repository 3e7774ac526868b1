"""Mutations of files: the same input for the same seed, reader and number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from random import Random

NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9.]*")
NUMBERS = (  # in place of numbers
    b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e308", b"-1e308", b"1e300", b"1e150", b"1e30", b"1e12", b"1e10",
    b"1e9", b"-1e9", b"1e5", b"1e-5", b"1e-9", b"1e-150", b"1e-310", b"5e-324", b"1e400", b"-0.0", b"0", b"-1", b"1",
    b"2147483648", b"18446744073709551616", b"1" + b"0" * 400, b"0x1F", b"1_0", b"true", b"null", b"[]", b"{}",
    b'"1"', b'""', b"", b"1,5", b"1e", b"0.1.2", b"--1", b"[1]", b"[[1, 2], 3]", b'{"a": 1}', b"1 2", b"1;2",
)  # fmt: skip
MOST = 400_000  # [bytes] length of an input


def mutated(seeds: Sequence[bytes], tokens: Sequence[bytes], rng: Random) -> bytes:
    """One of the seed files with one to six mutations, seldom another content altogether."""
    if rng.random() < 0.005:
        return rng.choice((b"", rng.randbytes(rng.randrange(1, 200)), rng.choice(tokens)))
    content = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 6))):
        binary = b"\0" in content
        content = (rng.choice(BYTES) if binary or rng.random() < 0.3 else rng.choice(WORDS))(content, tokens, rng)
    return content[:MOST]


def _flip(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    changed = bytes(x ^ (1 << rng.randrange(8)) for x in content[at : at + 1])
    return content[:at] + changed + content[at + 1 :]


def _overwrite(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at, length = rng.randrange(len(content) + 1), rng.choice((1, 2, 4, 8))
    new = rng.choice((rng.randbytes(length), b"\xff" * length, b"\0" * length, b"\x7f" + b"\xff" * (length - 1)))
    return content[:at] + new + content[at + length :]


def _insert(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice(tokens) + content[at:]


def _remove(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + content[at + rng.choice((1, 4, 20, 100)) :]


def _cut(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _repeat(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at, length = rng.randrange(len(content) + 1), rng.choice((1, 10, 100))
    return content[:at] + content[at : at + length] * rng.choice((2, 3, 50)) + content[at + length :]


def _number(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    found = list(NUMBER.finditer(content))
    return _replaced(content, rng.choice(found), rng.choice(NUMBERS)) if found else content


def _word(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    """Replace a word by another one of the file, or by a token."""
    found = list(WORD.finditer(content))
    if not found:
        return content
    other = rng.choice(found).group() if rng.random() < 0.8 else rng.choice(tokens)
    return _replaced(content, rng.choice(found), other)


def _lines(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    """Repeat, remove or exchange pieces between line ends, or between tags and brackets."""
    parts = re.split(rb"(?<=[\n>,;}\]])", content)
    at, other = rng.randrange(len(parts)), rng.randrange(len(parts))
    if (what := rng.randrange(3)) == 0:
        parts[at:at] = [parts[other]] * rng.choice((1, 2, 30))
    elif what == 1:
        del parts[at]
    else:
        parts[at], parts[other] = parts[other], parts[at]
    return b"".join(parts)


def _replaced(content: bytes, place: re.Match[bytes], new: bytes) -> bytes:
    return content[: place.start()] + new + content[place.end() :]


BYTES = (_flip, _overwrite, _insert, _remove, _cut, _repeat)
WORDS = (_number, _number, _number, _word, _lines)
