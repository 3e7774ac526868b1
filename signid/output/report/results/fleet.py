"""Fleet: sentences, terminal tables and page of changes, outliers and mismatch."""

from __future__ import annotations

from collections.abc import Mapping
from math import log10, nan
from typing import Any
from urllib.parse import quote

from rich.console import RenderableType
from rich.text import Text

from ..layout import confidence, figure, heading, new_table, paragraph, plural, share
from ..pages import render
from ..sections import Card
from .sentences import listed, quantity

UNDONE_STATE, FLAGGED_STATE = "not done", "flagged"  # states of a session in fleet.json
MAX_CELLS = 20  # maximum number of rows per table
MAX_TITLED = 2  # maximum number of robots in the headline
MAX_LISTED = 60  # maximum number of changes or outliers listed
TITLED = (("changes", "Changes between sessions of a robot"), ("outliers", "Outliers between robots of one kind"))
REPORT_FILE = "report.html"


def fleet_headline(document: Mapping[str, Any], reused: int = 0) -> str:
    """Name the robots that changed or are outliers, with one number each; without any, count the fleet."""
    sentences: dict[str, str] = {}
    outliers = findings(document, "outliers")
    apart = {(outlier["name"], outlier["number"]): f" ({_others(outlier)})" for outlier in outliers}
    for change in findings(document, "changes"):
        words = change_sentence(change, headline=True)
        sentences.setdefault(change["name"], words + apart.get((change["name"], change["number"]), ""))
    for outlier in outliers:
        sentences.setdefault(outlier["name"], outlier_sentence(outlier, headline=True))
    beyond = [f"and {plural(len(sentences) - MAX_TITLED, 'more robot')}"] if len(sentences) > MAX_TITLED else []
    return "; ".join([*list(sentences.values())[:MAX_TITLED], *beyond]) or fleet_sentence(document, reused)


def fleet_sentence(document: Mapping[str, Any], reused: int = 0) -> str:
    """Summarise a fleet in one sentence; `reused`: sessions that were stored by an earlier run."""
    robots, sessions = document["robots"], document["sessions"]
    differ = sum(robot["verdict"] not in ("", "nothing_missing") for robot in robots)
    undone = sum(session["state"] == UNDONE_STATE for session in sessions)
    parts = []
    if any(robot["verdict"] for robot in robots):
        parts.append(f"{plural(differ, 'robot')} {'differs' if differ == 1 else 'differ'} from the simulation")
    changed, apart = (len({x["name"] for x in findings(document, key)}) for key in ("changes", "outliers"))
    parts += [f"{plural(changed, 'robot')} changed between sessions"] if changed else []
    parts += [f"{plural(apart, 'robot')} {'is an outlier' if apart == 1 else 'are outliers'}"] if apart else []
    parts += [f"{plural(undone, 'session')} failed"] if undone else []
    counted = f"{plural(len(robots), 'robot')}, {plural(len(sessions), 'session')}"
    counted += f" ({reused} reused from an earlier run)" if reused else ""
    return ": ".join(filter(None, [counted, ", ".join(parts)]))


def findings(document: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """Changes or outliers of a fleet that are findings, the most probable first."""
    return [entry for entry in document.get(key, ()) if entry["finding"]]


def change_sentence(change: Mapping[str, Any], headline: bool = False) -> str:
    """A change between sessions of a robot; in a `headline` without times and probability."""
    before, after = (change[key] for key in ("before", "after"))
    values = (quantity(number["value"], number["std"], change["unit"]) for number in (before, after))
    times = f" ({before['time'] or before['sessions'][-1]})", f" ({after['time'] or after['session']})"
    dated = map(str.__add__, values, ("", "") if headline else times)
    words = f"{change['name']}: {change['title']} changed from {' to '.join(dated)}"
    size = f"{change['change'] / abs(before['value']):+.0%}".replace("%", " %, ") if before["value"] else ""
    return words if headline else f"{words}; {size}probability {confidence(change['probability'])}"


def outlier_sentence(outlier: Mapping[str, Any], headline: bool = False) -> str:
    """A robot that differs from the others of its kind; in a `headline` without their range and the probability."""
    value = quantity(outlier["value"], outlier["std"], outlier["unit"])
    words = f"{outlier['name']}: {outlier['title']} is {value}, {_others(outlier)}"
    ends = " to ".join(dict.fromkeys(figure(outlier["others"][key]) for key in ("least", "most")))
    return words if headline else f"{words} ({ends}); probability {confidence(outlier['probability'])}"


def _others(outlier: Mapping[str, Any]) -> str:
    others = outlier["others"]
    return f"{figure(others['median'])} {outlier['unit']} in the other {len(others['robots'])} robots"


def fleet_tables(document: Mapping[str, Any], reused: int = 0) -> list[RenderableType]:
    """Terminal tables of a fleet: changes and outliers, then one line for each robot."""
    robots, headline, sentence = document["robots"], fleet_headline(document, reused), fleet_sentence(document, reused)
    shown = [paragraph(text) for text in dict.fromkeys((headline, sentence))]
    for key, title in TITLED:
        if found := findings(document, key):
            shown += [
                heading(title),
                *(paragraph(x["sentence"]) for x in found[:MAX_CELLS]),
                *_more(len(found)),
            ]
    table = new_table("robot", "mismatch>", "joint", "after>", "explained>", "lacks")
    for robot in robots[:MAX_CELLS]:
        mismatch, *after = mismatch_cells(robot)
        lacks = Text(lacking(robot), no_wrap=True, overflow="ellipsis")
        table.add_row(robot["name"], mismatch, robot["joint"], *after, lacks)
    legend = "Mismatch, after: held-out rms over the noise floor, before and after the extension (last session)."
    shown += [heading("Robots by mismatch"), table, *_more(len(robots)), paragraph(legend)]
    return shown


def lacking(robot: Mapping[str, Any]) -> str:
    """Laws that a robot's simulation lacks, in words."""
    none = UNDONE_STATE if robot["undone"] == len(robot["sessions"]) else "-"
    words = {"nothing_missing": "nothing", "unknown": "physics that no law explains", "": none}
    said = [(law, 1) for law in robot["lacks"]]
    return listed(said, len(said)) or words.get(robot["verdict"], robot["verdict"])


def _more(count: int) -> list[RenderableType]:
    return [paragraph(f"and {count - MAX_CELLS} more in index.html")] if count > MAX_CELLS else []


def mismatch_cells(robot: Mapping[str, Any]) -> tuple[str, str, str]:
    """Mismatch before and after the extension, and the explained share."""
    before, after, explained = (nan if x is None else x for x in map(robot.get, ("mismatch", "left", "explained")))
    return figure(before), figure(after), share(explained)


def fleet_page(document: Mapping[str, Any], command: str = "", reused: int = 0) -> str:
    """Render index.html from the content of fleet.json, with links to the reports of its sessions."""
    headline, sentence = fleet_headline(document, reused), fleet_sentence(document, reused)
    sessions = {session["session"]: session for session in document["sessions"]}
    flagged = sum(session["state"] == FLAGGED_STATE for session in sessions.values())
    done = sum(session["state"] != UNDONE_STATE for session in document["sessions"])
    cards = [Card("sessions completed", f"{done} of {len(document['sessions'])}", "each with its own report")]
    if document["robots"] and (first := document["robots"][0])["mismatch"] is not None:
        beside = f"{first['name']}, {first['joint']}: held-out rms over the noise floor"
        cards.insert(0, Card("largest mismatch", f"{figure(first['mismatch'])} times", beside))
    rows = []
    robots = document["robots"]
    top = max([10.0, *(robot["mismatch"] for robot in robots if robot["mismatch"])])
    for robot in robots:
        (size, left, explained), mismatch = mismatch_cells(robot), robot["mismatch"]
        rows.append(
            {
                **{key: robot[key] for key in ("name", "kind", "time", "joint")},
                "sessions": len(robot["sessions"]),
                "size": size,
                "percent": 100 * max(0.0, log10(mismatch) / log10(top)) if mismatch else 0.0,
                "left": left,
                "explained": explained,
                "lacks": lacking(robot),
                "link": _link(sessions[robot["latest"]]),
            }
        )
    return render(
        "fleet.html",
        title=headline,
        over="fleet of robots" if headline == sentence else f"fleet: {sentence}",
        cards=cards,
        undone=[(key, x["said"]) for key, x in sessions.items() if x["state"] == UNDONE_STATE],
        flagged=plural(flagged, "session") if flagged else "",
        rows=rows,
        kinds=len({robot["kind"] for robot in document["robots"] if robot["kind"]}) > 1,
        found=[(title, [x["sentence"] for x in findings(document, key)[:MAX_LISTED]]) for key, title in TITLED],
        compared=document.get("comparison"),
        sessions=[(session, _link(session)) for session in document["sessions"]],
        document=document,
        command=command,
    )


def _link(session: Mapping[str, Any]) -> str:
    """Relative link to the report of a session."""
    return f"{quote(session['folder'])}/{REPORT_FILE}" if REPORT_FILE in session["files"] else ""
