"""Page of a fleet: robots by mismatch, common causes, drifts, and links to the session reports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from math import log10
from typing import Any
from urllib.parse import quote

from ....types import TWO_SIDED
from ..layout import figure, plural
from ..plots.frame import AFTER, BEFORE, axis, render
from ..policy import plot_markup
from ..results import fleet
from ..sections import Card, Plot

DRAWN, LISTED = 24, 60  # maximum number of drifts drawn and listed
FOUND = (("changes", "Changes between sessions of a robot"), ("outliers", "Outliers between robots of one kind"))
REPORT = "report.html"
SHADE = "rgba(209,112,14,.16)"
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def fleet_page(document: Mapping[str, Any], command: str = "") -> str:
    """Render index.html from the content of fleet.json, with links to the reports of its sessions."""
    drifts = document["drifts"]
    beyond = [drift for drift in drifts if drift["beyond_noise"]]
    sessions = {session["session"]: session for session in document["sessions"]}
    flagged = sum(session["state"] == fleet.FLAGGED for session in sessions.values())
    return render(
        "fleet.html",
        title=fleet.fleet_sentence(document),
        cards=list(_cards(document)),
        undone=[(one["session"], one["said"]) for one in document["sessions"] if one["state"] == fleet.UNDONE],
        flagged=plural(flagged, "session") if flagged else "",
        rows=list(_rows(document["robots"], sessions)),
        causes=list(_causes(document["causes"])),
        found=[(title, [one["sentence"] for one in fleet.findings(document, key)[:LISTED]]) for key, title in FOUND],
        compared=document.get("comparison"),
        drifting=[_drift_plot(drift) for drift in beyond[:DRAWN]],
        drawn=[f"{drift['name']}, {drift['number']}: {fleet.drift_sentence(drift)}" for drift in beyond[:DRAWN]],
        drifts=[_drift_row(drift) for drift in drifts[:LISTED]],
        looked=len(drifts),
        sessions=[(one, _link(one)) for one in document["sessions"]],
        document=document,
        command=command,
    )


def _cards(document: Mapping[str, Any]) -> Iterator[Card]:
    robots = document["robots"]
    if robots and robots[0]["mismatch"] is not None:
        first = robots[0]
        beside = f"{first['name']}, {first['joint']}: held-out rms over the noise floor"
        yield Card("largest mismatch", f"{figure(first['mismatch'])} times", beside)
    if document["causes"]:
        cause = document["causes"][0]
        beside = cause.get("title", cause["cause"])
        yield Card("most common cause", f"{len(cause['robots'])} of {plural(cause['of'], 'robot')}", beside)
    for key, title in FOUND:
        if some := fleet.findings(document, key):
            yield Card(title.lower(), plural(len(some), "parameter"), f"{some[0]['name']}: {some[0]['title']}")
    if document["drifts"]:
        count = sum(drift["beyond_noise"] for drift in document["drifts"])
        yield Card("significant drift", plural(count, "parameter"), f"of {len(document['drifts'])} tested")
    done = sum(session["state"] != fleet.UNDONE for session in document["sessions"])
    yield Card("sessions completed", f"{done} of {len(document['sessions'])}", "each with its own report")


def _rows(robots: Sequence[Mapping[str, Any]], sessions: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the ranking of robots."""
    top = max([10.0, *(robot["mismatch"] for robot in robots if robot["mismatch"])])
    for robot in robots:
        (size, left, explained), mismatch = fleet.mismatch_cells(robot), robot["mismatch"]
        yield {
            **{key: robot[key] for key in ("name", "kind", "time", "joint")},
            "sessions": len(robot["sessions"]),
            "size": size,
            "percent": 100 * max(0.0, log10(mismatch) / log10(top)) if mismatch else 0.0,
            "left": left,
            "explained": explained,
            "lacks": "no report" if robot["task"] == "reduce" else fleet.lacking(robot),
            "link": _link(sessions[robot["latest"]]),
        }


def _causes(causes: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    kinds = len({cause["kind"] for cause in causes}) > 1
    for cause in causes:
        yield {
            "sentence": fleet.cause_sentence(cause) + (f" ({cause['kind']})" if kinds else ""),
            "percent": 100 * len(cause["robots"]) / max(cause["of"], 1),
            "numbers": fleet.number_ranges(cause),
            "robots": cause["robots"],
        }


def _drift_plot(drift: Mapping[str, Any]) -> Plot:
    """Plot values with 95 % intervals over time, the regression line and the interval of its slope."""
    days, unit = drift["day"], drift["unit"] or "1"
    points = {
        "type": "scatter",
        "mode": "markers",
        "x": [_date(day) for day in days],
        "y": drift["value"],
        "error_y": {"type": "data", "array": [TWO_SIDED * std for std in drift["std"]], "thickness": 1.2, "width": 3},
        "marker": {"color": AFTER, "size": 6},
        "hovertemplate": plot_markup("%{y:.4g} $unit, %{x}<extra></extra>", unit=unit),
    }
    ends, slope = [min(days), max(days)], drift["slope"]
    line = {"type": "scatter", "mode": "lines", "hoverinfo": "skip"}
    fit = {**line, **_straight(drift, ends, 0.0), "line": {"color": BEFORE, "dash": "dot", "width": 2}}
    edges = [_straight(drift, way, side * slope["half"]) for side, way in ((-1, ends), (1, ends[::-1]))]
    corners = {axis: [x for edge in edges for x in edge[axis]] for axis in "xy"}
    fan = {**line, **corners, "line": {"width": 0}, "fill": "toself", "fillcolor": SHADE}
    layout = {"xaxis": axis("date, UTC", type="date", nticks=5), "yaxis": axis(f"value [{unit}]", nticks=6)}
    return Plot(f"{drift['name']}: {drift['number']}", [fan, fit, points], layout)


def _straight(drift: Mapping[str, Any], days: Sequence[float], steeper: float) -> dict[str, list[Any]]:
    """Points of the regression line, or of a steeper line through its centre."""
    slope, middle = drift["slope"]["value"] + steeper, drift["line"]
    return {"x": [_date(day) for day in days], "y": [middle["value"] + slope * (day - middle["day"]) for day in days]}


def _drift_row(drift: Mapping[str, Any]) -> tuple[str, ...]:
    slope, change = fleet.drift_sentence(drift).partition(", ")[0], fleet.drift_change(drift)
    count, beyond = str(len(drift["day"])), "yes" if drift["beyond_noise"] else "no"
    return drift["name"], drift["number"], count, slope, change, figure(drift["chance"], 2), beyond


def _date(day: float) -> str:
    return (EPOCH + timedelta(days=round(day * 86_400) / 86_400)).strftime("%Y-%m-%d %H:%M:%S")


def _link(session: Mapping[str, Any]) -> str:
    """Relative link to the report of a session."""
    return f"{quote(session['folder'])}/{REPORT}" if REPORT in session["files"] else ""
