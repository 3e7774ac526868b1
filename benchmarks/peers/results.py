"""Results of the three tools on one case, their evaluation, and tables."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

import signid
from signid.diagnose import Diagnosis
from signid.model import Model
from signid.output.report.results.diagnosis import diagnosis_document
from signid.types import Recording

from ..concealed.evaluate import Truth, is_right, is_twin
from ..plants.control import Track
from ..summary import frame
from .ask import Peer
from .job import SIGNS, Arm, Case, hand_over, record

MAIN = {"base_tilt": "y", "asymmetric_friction": "coulomb_positive"}  # displayed parameter, if not the first


@dataclass(frozen=True)
class Named:
    """One finding with its main parameter."""

    effect: str
    joint: str | None
    role: str
    probability: float
    key: str
    value: float
    std: float | None
    truth: float | None  # true value if effect and joint are right
    right: bool


@dataclass(frozen=True)
class Result:
    """Evaluation of one diagnosis."""

    outcome: str  # named, twin, listed, unknown, nothing, wrong, refused; healthy robot: clean or alarm
    verdict: str
    findings: tuple[Named, ...]
    joints: int  # number of named joints among those with the fault
    before: float  # held-out rms over the noise floor, rms over joints
    after: float
    flags: tuple[str, ...]
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the fault is named first, or the healthy robot is found clean."""
        return self.outcome in ("named", "clean")


def diagnose(case: Case, folder: Path, train: Track, test: Track) -> Result:
    """Diagnose with the description, the drives, and missing signs if they are declared."""
    model = signid.load_model(folder / "robot.urdf")
    one, other = (_read(track, model, case.declared) for track in (train, test))
    start = time.process_time()
    try:
        found = signid.diagnose(model, [one], held_out=[other])
    except signid.SignidError as error:
        nan, named = float("nan"), bool(case.words) and any(word in str(error) for word in case.words)
        return Result(
            "named" if named else "refused", "refused", (), 0, nan, nan, (str(error),), time.process_time() - start
        )
    return evaluate(case, found, time.process_time() - start)


def evaluate(case: Case, found: Diagnosis, seconds: float) -> Result:
    """Evaluate a diagnosis."""
    document = diagnosis_document(found)
    named = tuple(_named(case, finding) for finding in document["findings"])
    floor = found.before.irreducible_rms
    before, after = (float(np.sqrt(np.mean((fit.held_out_rms / floor) ** 2))) for fit in (found.before, found.after))
    places = {x.joint for x in named if x.right}
    outcome = _outcome(case, found, document["findings"])
    return Result(outcome, found.verdict, named, len(places), before, after, found.flags, seconds)


def truth(case: Case) -> Truth:
    """Fault in the form of `concealed.names`."""
    return Truth((case.effect,), case.joints, None, {})


def _read(track: Track, model: Model, unsigned: bool) -> Recording:
    return signid.read_recording({"t": track.t, "q": track.q, "tau": track.tau}, model.robot, unsigned=unsigned)


def _named(case: Case, finding: Mapping[str, Any]) -> Named:
    effect, joint, right = finding["effect"], finding["joint"], is_right(finding, truth(case))
    numbers = finding["parameters"]
    key = MAIN.get(effect, next(iter(numbers), ""))
    one = numbers.get(key, {"value": float("nan"), "std": None})
    true = next((f.numbers[key] for f in case.faults if right and f.joint == joint), None)
    return Named(effect, joint, finding["role"], finding["probability"], key, one["value"], one["std"], true, right)


def _outcome(case: Case, found: Diagnosis, findings: Sequence[Mapping[str, Any]]) -> str:
    causes = [x for x in findings if x["role"] == "cause"]
    if not case.effect:
        return "clean" if found.verdict == "nothing_missing" else "alarm"
    if case.effect == SIGNS:
        known = found.signs is not None or any(word in flag for flag in found.flags for word in case.words)
        return "wrong" if causes else "named" if known else "nothing"
    true, listed = truth(case), [*findings, *(rival for x in findings for rival in x["alternatives"])]
    if causes and is_right(causes[0], true):
        return "named"
    if causes and is_twin(causes[0], true, found.robot.joints):
        return "twin"
    if any(is_right(x, true) for x in listed):
        return "listed"
    return "wrong" if causes else {"unknown": "unknown"}.get(found.verdict, "nothing")


Answer = dict[str, Any]

DECLARED = 1.2  # error limit of a joint over its validation error on the healthy robot [1]


@dataclass(frozen=True)
class PeerResult:
    """Result of a peer on one case; without answer if the peer is not installed or not applicable."""

    answer: Answer | None
    new: tuple[str, ...] = ()  # report lines absent for the healthy robot, numbers and names aside
    beyond: tuple[str, ...] = ()  # joints with a validation error above the limit
    ratio: float | None = None  # cost or error over that of the healthy robot [1]
    named: bool = False  # a new line contains a word for the cause


@dataclass(frozen=True)
class Row:
    """Results on one case."""

    case: Case
    signid: Result
    figaroh: PeerResult
    mujoco: PeerResult


def measure(
    arm: Arm, cases: Sequence[Case], peers: tuple[Peer, Peer], durations: tuple[float, float, float], folder: Path
) -> Iterator[Row]:
    """Record each case, run all three tools, and compare the peers' answers with those on the healthy robot, the first.

    Durations [s]: of the two recordings and of the closed-loop simulation. The folder holds the description.
    """
    first: tuple[Answer | None, ...] = ()
    for case in cases:
        train, test = (record(arm, case, seed, duration) for seed, duration in enumerate(durations[:2]))
        hand_over(arm, train, test, durations[2], folder)
        answers = tuple(None if case.declared else peer.ask(folder) for peer in peers)
        first = first or answers
        compared = (compare(case, *pair) for pair in zip(answers, first, strict=True))
        yield Row(case, diagnose(case, folder, train, test), *compared)


def compare(case: Case, answer: Answer | None, healthy: Answer | None) -> PeerResult:
    """Compare an answer with that on the healthy robot."""
    if answer is None or healthy is None or "failed" in answer or "failed" in healthy:
        return PeerResult(answer)
    known = {_kind(line) for line in healthy["insights"]}
    new = tuple(line for line in answer["insights"] if _kind(line) not in known)
    limits = {name: DECLARED * x for name, x in healthy.get("joints", {}).items()}
    beyond = tuple(name for name, limit in limits.items() if not answer["joints"][name] <= limit)
    size = "cost" if "cost" in answer else "rmse"
    named = any(word in line.lower() for line in new for word in case.words)
    return PeerResult(answer, new, beyond, answer[size] / healthy[size], named)


def _kind(line: str) -> str:
    """Report line without numbers and listed parameters."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", re.sub(r"(Parameter) \S+", r"\1", line).partition(":")[0])


ABSENT = "not installed"


def tables(rows: Sequence[Row], versions: tuple[str, str]) -> tuple[Table, Table, Table]:
    """One table per tool, signid first."""
    return show_signid(rows), show_figaroh(rows, versions[0]), show_mujoco(rows, versions[1])


def show_signid(rows: Sequence[Row]) -> Table:
    """Table of outcome, first finding and held-out error."""
    names = ("fault", "signid", "first finding", "P", "number (truth)", "joints", "held out / floor", "CPU s")
    table = frame("signid", names, left=3)
    for row in rows:
        x = row.signid
        ratio = f"{x.before:.2f} -> {x.after:.2f}"
        cells = (row.case.name, x.outcome, *_first(x), _places(row), ratio, f"{x.seconds:.1f}")
        table.add_row(*cells, style="" if x.right else "red")
    return table


def show_figaroh(rows: Sequence[Row], version: str) -> Table:
    """Table of errors and report lines."""
    names = ("fault", "new report lines", "names it", "fit, N.m", "held out", "joints beyond", "CPU s")
    table = frame(f"figaroh {version or ABSENT}", names, left=3)
    for row in rows:
        x, answer = row.figaroh, row.figaroh.answer
        if answer is None or "failed" in answer:
            table.add_row(row.case.name, _silent(row, answer, version))
            continue
        errors = (f"{answer['rmse']:.3f}", f"{answer['held_out']:.3f}", f"{len(x.beyond)}")
        table.add_row(row.case.name, _lines(x), _names(row, x), *errors, f"{answer['seconds']:.1f}")
    return table


def show_mujoco(rows: Sequence[Row], version: str) -> Table:
    """Table of cost, errors, coverage and insights."""
    names = ("fault", "insights", "names it", "cost", "x clean", "armature off", "covered", "CPU s")
    table = frame(f"mujoco.sysid {version or ABSENT}", names, left=3)
    for row in rows:
        x, answer = row.mujoco, row.mujoco.answer
        if answer is None or "failed" in answer:
            table.add_row(row.case.name, _silent(row, answer, version))
            continue
        insights = "all within their bounds" if "within their bounds" in answer["insights"][0] else _bounds(answer)
        numbers = (f"{answer['cost']:.4f}", f"{x.ratio:.2f}", f"{100 * answer['errors']['armature']:.1f} %")
        table.add_row(
            row.case.name, insights, _names(row, x), *numbers, f"{answer['coverage']:.2f}", f"{answer['seconds']:.1f}"
        )
    return table


def _first(x: Result) -> tuple[str, str, str]:
    if not x.findings:
        return x.verdict.replace("_", " "), "", ""
    one = x.findings[0]
    value = f"{one.key} {one.value:.4g}" + ("" if one.std is None else f" ± {one.std:.2g}")
    truth = "" if one.truth is None else f" ({one.truth:.4g})"
    return f"{one.effect}, {one.joint or 'robot'}", f"{one.probability:.3f}", value + truth


def _places(row: Row) -> str:
    """Number of named joints among those with the fault."""
    return f"{row.signid.joints}/{len(row.case.faults)}" if row.case.faults else ""


def _silent(row: Row, answer: dict[str, object] | None, version: str) -> str:
    if answer is not None:
        return f"failed: {answer['failed']}"
    return "not supported" if row.case.declared and version else ABSENT


def _lines(x: PeerResult) -> str:
    return "none" if not x.new else f"{len(x.new)}: {x.new[0][:60]}"


def _bounds(answer: dict[str, list[str]]) -> str:
    return f"at a bound: {len(answer['insights'])}"


def _names(row: Row, x: PeerResult) -> str:
    return "" if not row.case.effect else "yes" if x.named else "no"
