"""Fleet: sentences and terminal tables of mismatch, common causes and drift."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import nan
from typing import Any

from rich.console import RenderableType

from ....types import TWO_SIDED
from ..layout import confidence, figure, heading, new_table, paragraph, plural, share, with_interval
from .sentences import listed, quantity

UNDONE, FLAGGED = "not done", "flagged"  # states of a session in fleet.json
SHOWN, FEW = 20, 4  # maximum number of rows per table and of parameters per cause


def fleet_sentence(document: Mapping[str, Any]) -> str:
    """Summarise a fleet in one sentence."""
    robots, sessions = document["robots"], document["sessions"]
    differ = sum(robot["verdict"] not in ("", "nothing_missing") for robot in robots)
    drifting = len({drift["name"] for drift in document["drifts"] if drift["beyond_noise"]})
    undone = sum(session["state"] == UNDONE for session in sessions)
    parts = []
    if any(robot["verdict"] for robot in robots):
        parts.append(f"{plural(differ, 'robot')} {_do(differ, 'differs', 'differ')} from the simulation")
    if document["drifts"]:
        parts.append(f"{plural(drifting, 'robot')} {_do(drifting, 'drifts', 'drift')}")
    changed, apart = (len({one["name"] for one in findings(document, key)}) for key in ("changes", "outliers"))
    parts += [f"{plural(changed, 'robot')} changed between sessions"] if changed else []
    parts += [f"{plural(apart, 'robot')} {_do(apart, 'is an outlier', 'are outliers')}"] if apart else []
    parts += [f"{plural(undone, 'session')} failed"] if undone else []
    counted = f"{plural(len(robots), 'robot')}, {plural(len(sessions), 'session')}"
    return ": ".join(filter(None, [counted, ", ".join(parts)]))


def findings(document: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """Changes or outliers of a fleet that are findings, the most probable first."""
    return [one for one in document.get(key, ()) if one["finding"]]


def change_sentence(change: Mapping[str, Any]) -> str:
    """A change between sessions of a robot, with its probability."""
    before, after, unit = change["before"], change["after"], change["unit"]
    first, last = before["time"] or before["sessions"][-1], after["time"] or after["session"]
    values = (quantity(one["value"], one["std"], unit) for one in (before, after))
    size = f"{change['change'] / abs(before['value']):+.0%}".replace("%", " %, ") if before["value"] else ""
    course = f"from {next(values)} ({first}) to {next(values)} ({last})"
    return f"{change['name']}: {change['title']} changed {course}; {size}{_sure(change)}"


def outlier_sentence(outlier: Mapping[str, Any]) -> str:
    """A robot that differs from the others of its kind, with its probability."""
    others, unit = outlier["others"], outlier["unit"]
    own = quantity(outlier["value"], outlier["std"], unit)
    ends = " to ".join(dict.fromkeys(figure(others[key]) for key in ("least", "most")))
    rest = f"{figure(others['median'])} {unit} in the other {len(others['robots'])} robots ({ends})"
    return f"{outlier['name']}: {outlier['title']} is {own}, {rest}; {_sure(outlier)}"


def _sure(finding: Mapping[str, Any]) -> str:
    return f"probability {confidence(finding['probability'])}"


def cause_sentence(cause: Mapping[str, Any]) -> str:
    """Number of robots that lack the same law, in a sentence."""
    count = len(cause["robots"])
    return (
        f"{count} of {plural(cause['of'], 'robot')} {_do(count, 'lacks', 'lack')} {cause.get('title', cause['cause'])}"
    )


def drift_sentence(drift: Mapping[str, Any]) -> str:
    """Slope and change of a parameter, in words."""
    slope = drift["slope"]
    value, half = with_interval(slope["value"], slope["half"] / TWO_SIDED)
    return f"{value} ± {half} {slope['unit']}, {drift_change(drift)} in total"


def drift_change(drift: Mapping[str, Any]) -> str:
    """Total change of a drift."""
    return f"{drift['change']:+.2g} {drift['unit']}".rstrip()


def fleet_tables(document: Mapping[str, Any]) -> list[RenderableType]:
    """Terminal tables of a fleet."""
    robots = document["robots"]
    table = new_table("robot", "mismatch>", "joint", "after>", "explained>", "lacks")
    for robot in robots[:SHOWN]:
        mismatch, *after = mismatch_cells(robot)
        table.add_row(robot["name"], mismatch, robot["joint"], *after, lacking(robot))
    legend = "Mismatch, after: held-out rms over the noise floor, before and after the extension (last session)."
    shown = [paragraph(fleet_sentence(document)), table, *_more(len(robots)), paragraph(legend)]
    if document["causes"]:
        shown += [heading("Common causes"), *map(paragraph, _causes(document["causes"]))]
    for key, title in (("changes", "Changes between sessions"), ("outliers", "Outliers between robots of one kind")):
        if found := findings(document, key):
            shown += [heading(title), *(paragraph(one["sentence"]) for one in found[:SHOWN]), *_more(len(found))]
    drifting = [drift for drift in document["drifts"] if drift["beyond_noise"]]
    if drifting:
        sentences = (f"{drift['name']}: {drift['number']}: {drift_sentence(drift)}" for drift in drifting[:SHOWN])
        shown += [heading("Significant drift"), *map(paragraph, sentences), *_more(len(drifting))]
    return shown


def lacking(robot: Mapping[str, Any]) -> str:
    """Laws that a robot's simulation lacks, in words."""
    none = UNDONE if robot["undone"] == len(robot["sessions"]) else "-"
    words = {"nothing_missing": "nothing", "unknown": "physics that no law explains", "": none}
    lacks = robot.get("lacks", robot["causes"])
    return listed([(one, 1) for one in lacks], len(lacks)) or words.get(robot["verdict"], robot["verdict"])


def number_ranges(cause: Mapping[str, Any]) -> list[str]:
    """Ranges of a cause's parameters over the robots; parameters consistent with zero are only counted."""
    sizes = [(max(abs(number["least"]), abs(number["most"])), number) for number in cause["numbers"]]
    shown = [number for size, number in sizes if size >= TWO_SIDED * number["std"]]
    ranges = [_range(number, many=len(cause["robots"]) > 2) for number in shown]
    hidden = len(cause["numbers"]) - len(shown)
    return [*ranges, f"{plural(hidden, 'more parameter')} could be zero"] if shown and hidden else ranges


def _range(number: Mapping[str, Any], many: bool) -> str:
    ends = list(dict.fromkeys(figure(number[key]) for key in ("least", "most")))
    middle = f", median {figure(number['median'])}" if many else ""
    return f"{number['key'].replace('_', ' ')} {' to '.join(ends)}{middle} {number['unit']}".rstrip()


def _causes(causes: list[Mapping[str, Any]]) -> Iterator[str]:
    kinds = len({cause["kind"] for cause in causes}) > 1
    for cause in causes[:SHOWN]:
        numbers = number_ranges(cause)[:FEW]
        which = [f"({cause['kind']})"] if kinds else []
        yield " ".join([cause_sentence(cause), *which]) + (f": {', '.join(numbers)}" if numbers else "")


def _more(count: int) -> list[RenderableType]:
    return [paragraph(f"and {count - SHOWN} more in index.html")] if count > SHOWN else []


def mismatch_cells(robot: Mapping[str, Any]) -> tuple[str, str, str]:
    """Mismatch before and after the extension, and the explained share."""
    before, after, explained = (nan if x is None else x for x in map(robot.get, ("mismatch", "left", "explained")))
    return figure(before), figure(after), share(explained)


def _do(count: int, one: str, many: str) -> str:
    return one if count == 1 else many
