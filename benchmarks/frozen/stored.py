"""Principal numbers of the documents of each case, which another processor reproduces to the stated digits."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .compare import FLOAT, Difference

AGREE = 2e-6  # of the largest number of its kind; signid states 1e-6, and stored numbers are rounded
DIGITS, LONGEST, MOST = 7, 80, 30  # of stored numbers, texts and lists
LEFT_OUT = set("schema version seed inputs notes recordings sentence not_identifiable content_rate".split())
SEARCHED = {"pbrp": ["robot", "joints", "base_parameters", "flags"], "signs-tree": ["robot", "joints", "signs"]}


def principal(case: str, folder: Path) -> dict[str, Any]:
    """Exit codes of a case, and what is kept of its documents."""
    kept: dict[str, Any] = {}
    if (codes := folder / "codes.txt").exists():
        kept["codes"] = [int(line.split()[0]) for line in codes.read_text().splitlines()]
    for path in sorted([*folder.glob("*.stdout"), *folder.glob("*.json")]):
        text = path.read_text()
        if path.name.endswith("model.json") or not text.startswith("{") or path.name.endswith("session.json"):
            continue
        try:
            document = json.loads(text)
        except json.JSONDecodeError:  # events, one a line
            continue
        kept[path.name] = pruned({key: document[key] for key in SEARCHED.get(case, document) if key in document})
    return kept


def pruned(content: Any) -> Any:
    """A document without long texts and lists; numbers are rounded, and left out of flags."""
    if isinstance(content, Mapping):
        pairs = ((key, pruned(value)) for key, value in content.items() if key not in LEFT_OUT)
        return {key: value for key, value in pairs if value not in (None, {}, [])}
    if isinstance(content, list):
        return [pruned(value) for value in content] if len(content) <= MOST else []
    if isinstance(content, float):
        return float(f"{content:.{DIGITS}g}")
    if isinstance(content, str):
        return re.sub(r"\d+", "#", FLOAT.sub("#", content))[:LONGEST]
    return content


def leaves(content: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Places and values of a document."""
    if not isinstance(content, dict | list):
        yield place, content
        return
    for key, value in content.items() if isinstance(content, dict) else enumerate(content):
        yield from leaves(value, f"{place}/{key}")


def compare_stored(stored: Mapping[str, Any], found: Mapping[str, Any]) -> list[Difference]:
    """Differences of principal numbers of cases beyond the tolerance, and of everything else at all."""
    differences = list[Difference]()
    for case, now in found.items():
        old, new = dict(leaves(stored.get(case, {}))), dict(leaves(now))
        largest: dict[str, float] = defaultdict(float)
        for place, value in old.items():
            if isinstance(value, float):
                largest[_kind(place)] = max(largest[_kind(place)], abs(value))
        for place in dict.fromkeys([*old, *new]):
            a, b = old.get(place), new.get(place)
            close = isinstance(a, float) and isinstance(b, float) and abs(a - b) <= AGREE * largest[_kind(place)]
            if a != b and not close:
                shown = (None if value is None else str(value) for value in (a, b))
                differences.append(Difference(case, place, *shown))
    return differences


def _kind(place: str) -> str:
    return re.sub(r"/(\d+|(?:link|joint)_\d+)(?=/|$)", "/", place)
