"""Rows of all cases under several settings of the tuned constants, kept in a folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from signid.model import Model
from signid.types import Recording

from .case import Case
from .constants import Setting, applied
from .run import Attempt, Begun, attempt, begin, bound, judged
from .sets import RealSet
from .shared import Memory, shared_steps

SOURCES = Path(__file__).parents[2]
MADE_BY = ("band", "case", "cases", "changes", "evaluate", "names", "nature", "payloads", "run", "sets")
KEPT = ("set", "kind", "what", "outcome", "fair", "known", "causes", "seconds")  # columns of a row in the folder
Row = dict[str, Any]


def fill(one: RealSet, settings: Sequence[Setting], folder: Path) -> None:
    """Diagnose the cases of a set that the folder lacks under these settings, and append their rows.

    Args:
        one: set of recordings.
        settings: constants that are not as they are; `()` for none.
        folder: where `SET.jsonl` is kept; rows of another version of the code do not count.
    """
    code, done = digest(), {(row["setting"], row["what"], row["kind"]) for row in load(folder, [one.name])}
    if all((label(x), "all", "end") in done for x in settings):
        return
    begun, memory = begin(one), Memory()
    controls = {x: _attempt(begun.setup.model, begun.setup.b, x, memory) for x in settings}
    with (folder / f"{one.name}.jsonl").open("a", encoding="utf-8") as file:
        for case in begun.cases():
            missing = [x for x in settings if (label(x), case.what, case.kind) not in done]
            for row in _rows(begun, case, missing, controls):
                file.write(json.dumps({"code": code, **row}) + "\n")
            file.flush()
        for values in settings:
            last = {"setting": label(values), "set": one.name, "what": "all", "kind": "end"}
            file.write(json.dumps({"code": code, **last}) + "\n")


def load(folder: Path, sets: Sequence[str]) -> list[Row]:
    """Rows of the folder that this version of the code made.

    Args:
        folder: where `SET.jsonl` is kept.
        sets: names of sets.
    """
    code, files = digest(), [folder / f"{name}.jsonl" for name in sets]
    rows = [json.loads(line) for file in files if file.exists() for line in file.read_text("utf-8").splitlines()]
    return [row for row in rows if row["code"] == code]


def label(values: Setting) -> str:
    """Text of a setting, such as `SAID=0.3`.

    Args:
        values: constants that are not as they are.
    """
    return ", ".join(f"{name}={x:g}" for name, x in values)


def digest() -> str:
    """Digest of the code that makes a row."""
    files = [*sorted(SOURCES.glob("signid/**/*.py")), *(Path(__file__).parent / f"{name}.py" for name in MADE_BY)]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def _rows(begun: Begun, case: Case, settings: Sequence[Setting], controls: dict[Setting, Attempt]) -> Iterator[Row]:
    """One row per setting of a case."""
    memory = Memory()
    sizes = bound(begun.setup, case) if settings else np.empty(0)
    for values in settings:
        control = controls[values]
        found = control if begun.is_unchanged(case) else _attempt(case.model, case.b, values, memory)
        causes = [f"{x.effect} {x.joints}" for x in found.answer.candidates if x.cause]
        row = {"set": begun.one.name, "kind": case.kind, "what": case.what, "causes": causes, "seconds": found.seconds}
        row |= judged(case, found, control, begun.arm, sizes)
        yield {"setting": label(values), **{key: row[key] for key in KEPT}}


def _attempt(model: Model, b: Recording, values: Setting, memory: Memory) -> Attempt:
    with applied(values), shared_steps(memory, values):
        return attempt(model, [b], None)
