"""Joint evaluation of a fleet's sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...output.report.results.fleet import FLAGGED as MARKED, UNDONE
from ...output.report.results.sentences import finding_headline
from ...types import Input, Result
from ...version import __version__
from ..terminal import FLAGGED
from .changes import change_document
from .summary import Outcome

SCHEMA = "signid.fleet/1"


@dataclass(frozen=True, eq=False)
class Fleet(Result):
    """All sessions in the order of the manifest, and their joint evaluation."""

    outcomes: tuple[Outcome, ...]
    manifest: Input
    seed: int
    reused: int = 0  # number of sessions that an earlier run stored

    @property
    def robots(self) -> list[tuple[str, list[Outcome]]]:
        """Robots with their sessions in order of time; the largest latest mismatch first, then as in the manifest."""
        found: dict[str, list[Outcome]] = {outcome.entry.name: [] for outcome in self.outcomes}
        for outcome in sorted(self.outcomes, key=_moment):
            found[outcome.entry.name].append(outcome)
        return sorted(found.items(), key=lambda robot: -(_latest(robot[1]).summary.mismatch or -1.0))

    @property
    def flagged(self) -> bool:
        """Whether a session failed or is flagged."""
        return any(not outcome.done or outcome.code == FLAGGED for outcome in self.outcomes)

    def document(self) -> dict[str, Any]:
        """The content of fleet.json."""
        groups: dict[tuple[str, str, str], list[Outcome]] = {}
        for one in sorted(self.outcomes, key=_moment):
            if one.summary.numbers or one.summary.verdict:
                groups.setdefault((one.entry.name, one.entry.task, one.summary.kind), []).append(one)
        return {
            "schema": SCHEMA,
            "robots": [_robot(name, sessions) for name, sessions in self.robots],
            **change_document(list(groups.values())),
            "sessions": [_session(outcome) for outcome in self.outcomes],
            "inputs": [self.manifest._asdict()],
            "seed": self.seed,
            "version": __version__,
        }


def _moment(outcome: Outcome) -> tuple[float, int]:
    day = outcome.entry.day
    return float("-inf") if day is None else day, outcome.entry.line


def _latest(sessions: Sequence[Outcome]) -> Outcome:
    """The last session with a known mismatch, or else the last session."""
    return ([one for one in sessions if one.summary.mismatch is not None] or sessions)[-1]


def _taken(source: object, keys: str) -> Mapping[str, Any]:
    """Some fields of a session, or of its summary."""
    return {key: getattr(source, key) for key in keys.split()}


def _robot(name: str, sessions: Sequence[Outcome]) -> dict[str, Any]:
    latest = _latest(sessions)
    return {
        "name": name,
        "kind": latest.summary.kind,
        "sessions": [one.entry.session for one in sessions],
        "latest": latest.entry.session,
        **_taken(latest.entry, "time task"),
        **_taken(latest.summary, "mismatch joint left explained verdict"),
        "causes": [cause.name for cause in latest.summary.causes],
        "lacks": [finding_headline(cause.named) for cause in latest.summary.causes],
        "undone": sum(not one.done for one in sessions),
    }


def _session(outcome: Outcome) -> dict[str, Any]:
    return {
        **_taken(outcome.entry, "session name robot task time"),
        "recordings": list(outcome.entry.recordings),
        "state": UNDONE if not outcome.done else MARKED if outcome.code == FLAGGED else "done",
        "said": list(outcome.said),
        "folder": f"sessions/{outcome.entry.session}" if outcome.done else None,
        "files": list(outcome.files),
        **_taken(outcome.summary, "mismatch joint left verdict"),
        "causes": [cause.name for cause in outcome.summary.causes],
    }
