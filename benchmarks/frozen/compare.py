"""Comparison of two folders of texts; numbers of ten digits and more agree within 1e-9, everything else to the byte."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from pathlib import Path
from typing import NamedTuple

RELATIVE, SMALLEST = 1e-9, 1e-12  # tolerance of numbers, relative and absolute
PRECISE = 10  # significant digits from which a number is compared by its value
FLOAT = re.compile(r"[-+]?(?<![\w.])(?:\d+\.\d*(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+|\.\d+(?:[eE][-+]?\d+)?)(?![\w.])")
MASKED = (  # pattern, what stands for it
    (re.compile(r"\b\d+\.\d+\.\d+\b(?!\.)"), "<version>"),
    (re.compile(r"\b\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[-+]\d\d:?\d\d)?"), "<time>"),
    (re.compile(r"\b(took|after|in) \d+(\.\d+)? (s|min)\b"), r"\1 <duration>"),
)


class Difference(NamedTuple):
    """A place where two outputs differ; None: there is no such file or line."""

    case: str
    file: str
    before: str | None
    after: str | None


def same_number(one: str, other: str) -> bool:
    """Whether two numbers are the same text, or close to each other and one of them precise."""
    if one == other:
        return True
    a, b = float(one), float(other)
    return max(_digits(one), _digits(other)) >= PRECISE and abs(a - b) <= max(RELATIVE * max(abs(a), abs(b)), SMALLEST)


def _digits(number: str) -> int:
    mantissa = re.split("[eE]", number)[0]
    return len(re.sub(r"[-+.]", "", mantissa).lstrip("0"))


def differing_lines(before: str, after: str) -> Iterator[tuple[str | None, str | None]]:
    """Lines that differ, those of both texts side by side."""
    old, new = ([_masked(line) for line in text.splitlines()] for text in (before, after))
    keys, others = ([FLOAT.sub("#", line) for line in lines] for lines in (old, new))
    if keys == others:
        yield from (pair for pair in zip(old, new, strict=True) if not _same_numbers(*pair))
        return
    for kind, i, end, j, last in SequenceMatcher(None, keys, others).get_opcodes():
        for k in range(max(end - i, last - j)):
            pair = (old[i + k] if i + k < end else None, new[j + k] if j + k < last else None)
            if kind != "equal" or not _same_numbers(old[i + k], new[j + k]):
                yield pair


def _masked(line: str) -> str:
    for pattern, instead in MASKED:
        line = pattern.sub(instead, line)
    return line


def _same_numbers(one: str, other: str) -> bool:
    return one == other or all(map(same_number, FLOAT.findall(one), FLOAT.findall(other)))


def compare(reference: Path, current: Path, cases: Sequence[str]) -> list[Difference]:
    """All differences of the named cases; folders `reference` and `current` hold a folder of texts of each."""
    found = list[Difference]()
    for case in cases:
        names = {path.name for folder in (reference, current) for path in (folder / case).iterdir()}
        for name in sorted(names):
            one, other = (_text(folder / case / name) for folder in (reference, current))
            if one is None or other is None:
                found.append(Difference(case, name, one and "(a file)", other and "(a file)"))
            else:
                found += [Difference(case, name, *pair) for pair in differing_lines(one, other)]
    return found


def _text(path: Path) -> str | None:
    return path.read_text("utf-8") if path.exists() else None
