"""Statistics over rows, calibration of confidence, targets and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from ..summary import frame
from .paper import IDENTIFIABLE, PUBLISHED, QUOTED, Arm, coefficients, entries, identifiable
from .real import Report
from .simulated import FAILURES, NOISES, Kind
from .trial import Row, TargetResult

WRONG = 2.0  # distance of wrong parameters from the truth over that of the signed estimate [1]
EDGES = (0.0, 0.9, 0.99, 0.999, 1.0)  # of the confidence bins [1]
SURE = 0.999  # confidence above which a segment must be right [1]


@dataclass(frozen=True)
class Group:
    """Statistics of runs of one kind."""

    name: str
    runs: int
    perfect: float  # share of runs with all segments right
    optimal: float  # share of runs with proved optimum
    segments: int
    right: float  # share of right segments
    mixed: int
    samples: float  # share of right samples, mean over runs
    ratio: float  # median
    ratio_90: float  # 90th percentile
    seconds: float  # median
    wrong: int  # runs with a wrong segment or wrong parameters
    alarms: int  # wrong runs with a flag
    false_alarms: int  # other runs with a flag


@dataclass(frozen=True)
class Bin:
    """Segments of runs without flags with a confidence in a bin."""

    low: float
    high: float
    segments: int
    right: int
    said: float  # mean confidence; nan without segments


def is_wrong(row: Row) -> bool:
    """Whether a run has a wrong segment or wrong parameters."""
    return not row.perfect or bool(row.ratio > WRONG)


def summarise(rows: Sequence[Row]) -> list[Group]:
    """Statistics of each kind of run, in order of appearance."""
    names = dict.fromkeys(row.group for row in rows)
    return [gather(name, [row for row in rows if row.group == name]) for name in names]


def gather(name: str, rows: Sequence[Row]) -> Group:
    """Statistics of the runs of one kind."""
    wrong = [row for row in rows if is_wrong(row)]
    total = sum(row.segments for row in rows)
    ratios = [row.ratio for row in rows]
    return Group(
        name=name,
        runs=len(rows),
        perfect=float(np.mean([row.perfect for row in rows])),
        optimal=float(np.mean([row.optimal for row in rows])),
        segments=total,
        right=sum(row.right for row in rows) / max(total, 1),
        mixed=sum(row.mixed for row in rows),
        samples=float(np.mean([row.samples for row in rows])),
        ratio=float(np.median(ratios)),
        ratio_90=float(np.quantile(ratios, 0.9)),
        seconds=float(np.median([row.seconds for row in rows])),
        wrong=len(wrong),
        alarms=sum(bool(row.flags) for row in wrong),
        false_alarms=sum(bool(row.flags) for row in rows if not is_wrong(row)),
    )


def reliability(rows: Sequence[Row]) -> Iterator[Bin]:
    """Share of right segments by confidence over all exact runs without flag."""
    scores = [one for row in rows if not row.flags and row.method == "exact" for one in row.judged]
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        inside = [one for one in scores if low <= one.confidence < high or (high == 1.0 and one.confidence >= 1.0)]
        said = float(np.mean([one.confidence for one in inside])) if inside else float("nan")
        yield Bin(low, high, len(inside), sum(one.right for one in inside), said)


SEGMENTS = dict(zip(NOISES, (1.0, 1.0, 0.99, 0.99), strict=True))  # least share of right segments [1]
RATIO = dict(zip(NOISES, (1.0, 1.05, 1.2, 1.5), strict=True))  # largest median ratio, to two digits [1]
ALARMS = 0.9  # least share of flagged failures [1]


def of_rows(rows: Sequence[Row]) -> Iterator[TargetResult]:
    """Yield the result of each row with a target."""
    for row in rows:
        wanted = [f"{k} {v:g}" for k, v in vars(row.target).items() if v is not None]
        if wanted:
            found = f"{row.right}/{row.segments} segments" + (f", {', '.join(row.misses)}" if row.misses else "")
            yield TargetResult(f"{row.group} {row.case} ({', '.join(wanted)}): {found}", row.holds)


def of_table() -> TargetResult:
    """Result: all wrong entries of the printed table are explained."""
    wrong = [entry for entry in entries() if entry.wrong]
    explained = [entry for entry in wrong if entry.why != "unknown"]
    names = ", ".join(entry.name for entry in wrong)
    return TargetResult(f"{len(wrong)} of 13 printed coefficients are wrong ({names})", wrong == explained)


def of_groups(rows: Sequence[Row]) -> Iterator[TargetResult]:
    """Yield the results of simulated arms at each noise, then of the flags."""
    groups = {group.name: group for group in summarise(rows)}
    for noise in NOISES:
        group = groups[f"{100 * noise:g} % noise"]
        met = group.right >= SEGMENTS[noise] and round(group.ratio, 2) <= RATIO[noise]
        found = f"{100 * group.right:.2f} % of segments, median ratio {group.ratio:.3f}, {100 * group.perfect:.0f} %"
        yield TargetResult(f"{group.name} ({SEGMENTS[noise]:.0%}, {RATIO[noise]:g}): {found} of runs perfect", met)
    yield alarm([groups[name] for name in FAILURES])


def alarm(groups: Sequence[Group]) -> TargetResult:
    """Result: share of flagged failures."""
    wrong, flagged = sum(group.wrong for group in groups), sum(group.alarms for group in groups)
    return TargetResult(f"{flagged} of {wrong} deliberate failures flagged ({ALARMS:.0%})", flagged >= ALARMS * wrong)


def of_constants(kinds: Sequence[Kind]) -> Iterator[TargetResult]:
    """Yield the errors of torque constants, for information."""
    for kind in kinds:
        errors = f"error {100 * kind.median:.1f} % (median), {100 * kind.largest:.1f} % (largest)"
        yield TargetResult(f"torque constants, {kind.name}: {errors}, {kind.refused} of {kind.arms} arms refused", None)


def of_bins(bins: Sequence[Bin]) -> TargetResult:
    """Result: no certain segment is wrong."""
    sure = [one for one in bins if one.low >= SURE]
    total, right = sum(one.segments for one in sure), sum(one.right for one in sure)
    return TargetResult(
        f"{total - right} of {total} segments with p >= {SURE:g} and no flag are wrong (0)", total == right
    )


def of_all(rows: Sequence[Row]) -> TargetResult:
    """Counts of wrong runs without flag and right runs with flag, for information."""
    wrong = [row for row in rows if is_wrong(row)]
    silent, false = sum(not row.flags for row in wrong), sum(bool(row.flags) for row in rows if not is_wrong(row))
    text = f"{silent} of {len(wrong)} wrong runs are not flagged, {false} of {len(rows) - len(wrong)} right ones are"
    return TargetResult(text, None)


def of_hobby(report: Report) -> TargetResult:
    """Result: no certain segments without flag."""
    sure, count = sum(joint.sure for joint in report.joints), len(report.flags)
    return TargetResult(
        f"SO-101: {sure} segments with p >= .999, {count} flags (no certainty without a flag)", report.holds
    )


Column = tuple[str, Callable[[Row], str]]


def _share(part: float, whole: float = 1.0) -> str:
    return f"{100 * part / whole:.1f} %" if whole else ""


def _number(x: float, form: str = ".3g") -> str:
    return "" if x != x else format(x, form)


COLUMNS: dict[str, Column] = {
    "case": ("case", lambda r: r.case),
    "method": ("method", lambda r: r.method),
    "segments": ("segments", lambda r: f"{r.right}/{r.segments}"),
    "mixed": ("mixed", lambda r: str(r.mixed)),
    "samples": ("samples", lambda r: _share(r.samples)),
    "small": ("small ones", lambda r: "" if r.small != r.small else _share(r.small)),
    "b": ("b", lambda r: str(r.parameters)),
    "error": ("error", lambda r: _number(r.error)),
    "off": ("off signed", lambda r: _number(r.off)),
    "ratio": ("ratio", lambda r: _number(r.ratio)),
    "worse": ("held out", lambda r: _number(r.worse, ".3f")),
    "seconds": ("s", lambda r: f"{r.seconds:.2f}"),
    "proof": ("proof", lambda r: "gap 0" if r.optimal else f"gap {r.gap:.2g}"),
    "nodes": ("nodes", lambda r: str(r.nodes)),
    "flags": ("flags", lambda r: str(len(r.flags) or "")),
}


def show_rows(
    title: str, rows: Sequence[Row], keys: Sequence[str], more: Sequence[tuple[str, Callable[[Row], str]]] = ()
) -> Table:
    """Table of selected columns; rows that miss their target are red."""
    columns = [*(COLUMNS[key] for key in keys), *more]
    table = frame(title, [name for name, _ in columns])
    for row in rows:
        table.add_row(*(text(row) for _, text in columns), style="" if row.holds else "red")
    return table


def show_groups(title: str, groups: Sequence[Group]) -> Table:
    """Table with one line per group of runs."""
    names = (
        "runs",
        "perfect",
        "proved",
        "segments",
        "mixed",
        "samples",
        "ratio",
        "90 %",
        "s",
        "wrong",
        "flagged",
        "false flags",
    )
    table = frame(title, ("", *names))
    for g in groups:
        shares = [_share(g.perfect), _share(g.optimal), f"{_share(g.right)} of {g.segments}", str(g.mixed)]
        rest = [_share(g.samples), f"{g.ratio:.3f}", f"{g.ratio_90:.3g}", f"{g.seconds:.2f}"]
        table.add_row(g.name, str(g.runs), *shares, *rest, str(g.wrong), str(g.alarms), str(g.false_alarms))
    return table


def show_bins(bins: Sequence[Bin]) -> Table:
    """Table of confidence and share of right segments."""
    table = frame("confidence of segments in runs without flags", ("confidence", "segments", "mean", "right"))
    for one in bins:
        edge = "1" if one.high == 1.0 else f"below {one.high:g}"
        right = f"{one.right} ({_share(one.right, one.segments)})" if one.segments else ""
        table.add_row(f"{one.low:g} to {edge}", str(one.segments), _number(one.said, ".5f"), right)
    return table


def show_entries() -> Table:
    """Table of printed and correct coefficients of the arm."""
    table = frame("coefficients of the 3R arm, kg.m2 and N.m", ("", "printed", "right", "", "why"))
    for entry in entries():
        mark = "wrong" if entry.wrong else ""
        table.add_row(entry.name, f"{entry.published:.{entry.digits}f}", f"{entry.right:.4f}", mark, entry.why)
    return table


def show_identifiable() -> Table:
    """Table of the identifiable combinations."""
    table = frame("the ten identifiable combinations", ("", "from printed", "right"))
    printed, right = identifiable(PUBLISHED), identifiable(coefficients(Arm()))
    for (name, _), one, other in zip(IDENTIFIABLE, printed, right, strict=True):
        table.add_row(name, f"{one:.4f}", f"{other:.4f}")
    return table


def show_quoted() -> Table:
    """Table of the published errors of the paper's four estimates."""
    table = frame("errors of the paper's four estimates (quoted, not recomputed)", ("against", "1", "2", "3", "4"))
    for name, errors in QUOTED.items():
        table.add_row(name, *(f"{error:g}" for error in errors))
    return table


def show_constants(kinds: Sequence[Kind]) -> Table:
    """Table of identified torque constants."""
    names = ("arms", "refused", "constants", "median error", "largest", "std", "within 2 std", "segments", "s")
    table = frame("unknown torque constants, 2 % noise", ("", *names, "flagged"))
    for kind in kinds:
        shares = [_share(x) for x in (kind.median, kind.largest, kind.said)]
        rest = [f"{kind.inside}/{kind.constants}", f"{kind.right}/{kind.segments}", f"{kind.seconds:.1f}"]
        table.add_row(
            kind.name, str(kind.arms), str(kind.refused), str(kind.constants), *shares, *rest, str(kind.flagged)
        )
    return table


def show_hobby(report: Report) -> Table:
    """Table of results without known truth."""
    title = f"SO-101: {report.parameters} base parameters, {len(report.flags)} flags, {report.seconds:.1f} s"
    table = frame(title, ("joint", "segments", "p >= .999", "| |tau| | error", "held out"))
    for joint in report.joints:
        table.add_row(joint.joint, str(joint.segments), str(joint.sure), f"{joint.train:.2f}", f"{joint.held_out:.2f}")
    return table
