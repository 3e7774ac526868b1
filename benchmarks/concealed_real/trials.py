"""Rows of all cases under several settings of the tuned constants of diagnosis, kept in a folder."""

from __future__ import annotations

import hashlib
import json
import pkgutil
import sys
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from signid.errors import InputError
from signid.model import Model
from signid.types import Recording

from .changes import Case
from .run import Attempt, Begun, attempt, begin, bound, judged
from .sets import RealSet

ROOT = "signid.diagnose"
SEARCH, BESIDE_MISFIT, CONCLUSION = "search", "search beside a known misfit", "conclusion"  # first reader of a constant
Setting = tuple[tuple[str, float], ...]  # names and values of the constants that are not as they are, sorted


@dataclass(frozen=True)
class Constant:
    """A tuned constant and the values that it is compared with."""

    name: str
    module: str  # its home, below signid.diagnose
    step: str  # SEARCH, BESIDE_MISFIT or CONCLUSION
    others: tuple[float, ...]

    @property
    def present(self) -> float:
        """Its present value."""
        return float(getattr(import_module(f"{ROOT}.{self.module}"), self.name))

    @property
    def values(self) -> tuple[float, ...]:
        """The present value, then the others."""
        return (self.present, *self.others)


TABLE = (
    Constant("MISFIT_GROWTH", "thresholds", BESIDE_MISFIT, (1.5, 3.0)),
    Constant("FIRST_LOG_ODDS", "thresholds", SEARCH, (3.0, 6.0)),
    Constant("NEXT_LOG_ODDS", "thresholds", SEARCH, (2.0, 5.0)),
    Constant("NOISE_ERROR", "thresholds", SEARCH, (1.0, 1.8)),
    Constant("MIN_CAUSE_SHARE", "thresholds", CONCLUSION, (0.07, 0.3)),
    Constant("REPLACEMENT_RATIO", "thresholds", CONCLUSION, (1.1, 2.5)),
    Constant("WORSE_WEIGHT", "thresholds", CONCLUSION, (1.0, 6.0)),
    Constant("MIN_REFIT_GAIN", "thresholds", CONCLUSION, (0.5, 2.0)),
    Constant("EQUAL_PREDICTION_GAIN", "thresholds", CONCLUSION, (0.05, 0.2)),
    Constant("CHANGED_PROBABILITY", "thresholds", CONCLUSION, (0.3, 0.7)),
)
CONSTANTS = {one.name: one for one in TABLE}


def setting(values: Mapping[str, float]) -> Setting:
    """Setting of some constants, without those that keep their present value."""
    return tuple(sorted((name, float(x)) for name, x in values.items() if float(x) != CONSTANTS[name].present))


@contextmanager
def applied(values: Setting) -> Iterator[None]:
    """Set constants in each module of signid.diagnose that holds them, and restore them in the end."""
    for found in pkgutil.walk_packages(import_module(ROOT).__path__, f"{ROOT}."):
        import_module(found.name)
    changed = [(module, name, module.__dict__[name]) for name, _ in values for module in _holders(name)]
    wanted = dict(values)
    try:
        for module, name, _ in changed:
            setattr(module, name, wanted[name])
        yield
    finally:
        for module, name, before in changed:
            setattr(module, name, before)


def _holders(name: str) -> list[ModuleType]:
    """Modules that hold the very object of a constant."""
    own = getattr(sys.modules[f"{ROOT}.{CONSTANTS[name].module}"], name)
    below = [x for key, x in list(sys.modules.items()) if key.startswith(f"{ROOT}.")]
    return [x for x in below if x.__dict__.get(name) is own]


RUN = import_module("signid.diagnose.run")
Memory = dict[Hashable, Any]


@contextmanager
def shared_steps(memory: Memory, values: Setting) -> Iterator[None]:
    """Reuse prepared recordings, rows and searches of earlier diagnoses of the same case; leave out the roll-outs.

    The same model and recordings are diagnosed each time. An identified model is asked two questions, with and without
    its misfit, so rows and searches are kept for each. A search is reused only where no constant that it reads differs.
    """

    def select_key(data: Any, *_: Any) -> Hashable:
        known = data.model.misfit is not None
        read = {SEARCH, BESIDE_MISFIT} if known else {SEARCH}
        return "select", known, tuple(x for x in values if CONSTANTS[x[0]].step in read)

    before = {name: getattr(RUN, name) for name in ("prepare_session", "build_in_time", "select", "roll_out")}
    kept = {
        "prepare_session": _kept(memory, before["prepare_session"], lambda model, *_: "prepare"),
        "build_in_time": _kept(memory, before["build_in_time"], lambda model, *_: ("build", model.misfit is None)),
        "select": _kept(memory, before["select"], select_key),
        "roll_out": _no_roll_out,
    }
    try:
        for name, function in kept.items():
            setattr(RUN, name, function)
        yield
    finally:
        for name, function in before.items():
            setattr(RUN, name, function)


def _kept(memory: Memory, function: Callable[..., Any], key: Callable[..., Hashable]) -> Callable[..., Any]:
    """Function that is called once per key."""

    def call(*given: Any) -> Any:
        name = key(*given)
        if name not in memory:
            memory[name] = function(*given)
        return memory[name]

    return call


def _no_roll_out(*_: Any, **__: Any) -> Any:
    raise InputError("roll-outs change no name")


SOURCES = Path(__file__).parents[2]
MADE_BY = ("changes", "evaluate", "run", "sets")
KEPT = ("set", "kind", "what", "outcome", "fair", "known", "causes", "seconds")  # columns of a row in the folder
Row = dict[str, Any]


def fill(one: RealSet, settings: Sequence[Setting], folder: Path) -> None:
    """Diagnose the cases of a set that SET.jsonl of the folder lacks under these settings, and append their rows.

    Rows of another version of the code do not count.
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
    """Rows of the folder that this version of the code made."""
    code, files = digest(), [folder / f"{name}.jsonl" for name in sets]
    rows = [json.loads(line) for file in files if file.exists() for line in file.read_text("utf-8").splitlines()]
    return [row for row in rows if row["code"] == code]


def label(values: Setting) -> str:
    """Text of a setting, such as `CHANGED_PROBABILITY=0.3`."""
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
