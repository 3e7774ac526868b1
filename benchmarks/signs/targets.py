"""Targets and their results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from .coefficients import entries
from .constants import Kind
from .hobby import Report
from .row import Row, TargetResult
from .simulated import FAILURES, NOISES
from .summary import SURE, Bin, Group, is_wrong, summarise

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
