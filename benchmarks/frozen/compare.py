"""Comparison of texts to the byte, but of long numbers by value; and of principal numbers within stated digits."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any, NamedTuple

RELATIVE, SMALLEST = 1e-9, 1e-12  # tolerance of numbers, relative and absolute
PRECISE = 10  # significant digits from which a number is compared by its value
FLOAT = re.compile(r"(?<![\w.])[-+]?(?:\d+\.\d*(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+)(?![\w.])")
CHANGING = re.compile(r"\b\d+\.\d+\.\d+\b|\b\d{4}-\d\d-\d\d[T ]\d\d:\d\d[\d:.]*")  # versions, times
PROGRESS = re.compile(r"^signid: [^\n]*: \d+ %, about [^\n]* left[^\n]*\n", re.MULTILINE)  # as the machine is busy
AGREE = 2e-6  # of the largest number of its kind; signid/README.md states 1e-6, and stored numbers are rounded
DIGITS, LONGEST, MOST = 7, 80, 30  # of stored numbers, texts and lists
DOCUMENT = re.compile(r"\d+\.stdout|(?!.*(?:sessions|model|loop)).*\.json")
LEFT_OUT = set("schema version seed inputs notes recordings sentence content_rate held_out_gain where".split())
SEARCHED = {  # parts that are stored; other numbers, as held_out_gain and where above, agree less across kernels
    "pbrp": ("joints", "flags"),
    "signs-tree": ("joints", "signs", "flags"),
    "check-commands": ("verdict", "headline", "units", "faults", "flags"),
}


class Difference(NamedTuple):
    """A place where two outputs differ; None: there is no such file or line."""

    case: str
    file: str
    before: str | None
    after: str | None


def same_number(one: str, other: str) -> bool:
    """Whether two numbers are the same text, or close to each other and one of them precise."""
    digits = max(len(re.sub(r"[eE].*|\D", "", number).lstrip("0")) for number in (one, other))
    a, b = float(one), float(other)
    return one == other or digits >= PRECISE and abs(a - b) <= max(RELATIVE * max(abs(a), abs(b)), SMALLEST)


def differing_lines(before: str, after: str) -> Iterator[tuple[str | None, str | None]]:
    """Lines that differ, those of both texts side by side."""
    old, new = (CHANGING.sub("<version or time>", PROGRESS.sub("", text)).split("\n") for text in (before, after))
    keys, others = ([FLOAT.sub("#", line) for line in lines] for lines in (old, new))
    aligned = [("equal", 0, len(old), 0, len(new))]  # at once, as in most files
    for kind, i, end, j, last in aligned if keys == others else SequenceMatcher(None, keys, others).get_opcodes():
        for k in range(max(end - i, last - j)):
            pair = (old[i + k] if i + k < end else None, new[j + k] if j + k < last else None)
            if kind != "equal" or not all(map(same_number, *(FLOAT.findall(line or "") for line in pair))):
                yield pair


def compare(reference: Path, current: Path, cases: Sequence[str]) -> list[Difference]:
    """All differences of the named cases; each folder holds a folder of texts for each case."""
    found = list[Difference]()
    for case in cases:
        for name in sorted({path.name for folder in (reference, current) for path in (folder / case).glob("*")}):
            paths = [folder / case / name for folder in (reference, current)]
            one, other = (path.read_text("utf-8") if path.exists() else None for path in paths)
            pairs = differing_lines(one, other) if one is not None and other is not None else [(one, other)]
            found += [Difference(case, name, *pair) for pair in pairs]
    return found


def principal(case: str, folder: Path) -> dict[str, Any]:
    """Exit codes of a case, and what is stored of its documents."""
    kept: dict[str, Any] = {path.name: path.read_text("utf-8").splitlines() for path in folder.glob("codes.txt")}
    for path in sorted(path for path in folder.iterdir() if DOCUMENT.fullmatch(path.name)):
        if path.read_text("utf-8").startswith("{\n"):
            document = json.loads(path.read_text("utf-8"))
            kept[path.name] = pruned({key: document[key] for key in SEARCHED.get(case, document) if key in document})
    return kept


def pruned(content: Any) -> Any:
    """A document without long texts and lists; numbers are rounded, and left out of sentences."""
    if isinstance(content, Mapping):
        pairs = ((key, pruned(value)) for key, value in content.items() if key not in LEFT_OUT)
        return {key: value for key, value in pairs if value not in (None, {}, [])}
    if isinstance(content, list):
        return [pruned(value) for value in content] if len(content) <= MOST else []
    if isinstance(content, str):
        return re.sub(r"\b\d+\b", "#", FLOAT.sub("#", content))[:LONGEST]
    return float(f"{content:.{DIGITS}g}") if isinstance(content, float) else content


def compare_stored(stored: Mapping[str, Any], found: Mapping[str, Any]) -> list[Difference]:
    """Numbers of each case beyond the tolerance, and all else that differs."""
    differences = list[Difference]()
    for case, now in found.items():
        old, new = dict(_leaves(stored.get(case, {}))), dict(_leaves(now))
        largest: dict[str, float] = defaultdict(float)
        for place, value in old.items():
            largest[_kind(place)] = max(largest[_kind(place)], abs(value) if isinstance(value, float) else 0.0)
        for place in dict.fromkeys([*old, *new]):
            a, b = old.get(place), new.get(place)
            close = isinstance(a, float) and isinstance(b, float) and abs(a - b) <= AGREE * largest[_kind(place)]
            if a != b and not close:
                differences.append(Difference(case, place, *(None if x is None else str(x) for x in (a, b))))
    return differences


def _leaves(content: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(content, dict | list):
        for key, value in content.items() if isinstance(content, dict) else enumerate(content):
            yield from _leaves(value, f"{place}/{key}")
    else:
        yield place, content


def _kind(place: str) -> str:
    return re.sub(r"/(\d+|(?:link|joint)_\d+)(?=/|$)", "/", place)
