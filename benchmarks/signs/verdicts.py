"""Targets, and whether they are met."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from .coefficients import entries
from .constants import Kind
from .hobby import Report
from .row import Row, Verdict
from .simulated import FAILURES, NOISES
from .summary import SURE, Bin, Group, is_wrong, summarise

SEGMENTS = dict(zip(NOISES, (1.0, 1.0, 0.99, 0.99), strict=True))  # share right, at least
RATIO = dict(zip(NOISES, (1.0, 1.05, 1.2, 1.5), strict=True))  # median, at most, to two digits
ALARMS = 0.9  # share of the failures that are flagged, at least


def of_rows(rows: Sequence[Row]) -> Iterator[Verdict]:
    """One for each row that has a target."""
    for row in rows:
        wanted = [f"{k} {v:g}" for k, v in vars(row.target).items() if v is not None]
        if wanted:
            found = f"{row.right}/{row.segments} segments" + (f", {', '.join(row.misses)}" if row.misses else "")
            yield Verdict(f"{row.group} {row.case} ({', '.join(wanted)}): {found}", row.holds)


def of_table() -> Verdict:
    """Whether each wrong entry of the printed table is explained."""
    wrong = [entry for entry in entries() if entry.wrong]
    explained = [entry for entry in wrong if entry.why != "unknown"]
    names = ", ".join(entry.name for entry in wrong)
    return Verdict(f"{len(wrong)} of 13 printed coefficients are wrong ({names})", wrong == explained)


def of_groups(rows: Sequence[Row]) -> Iterator[Verdict]:
    """Simulated arms at each noise, then the alarm."""
    groups = {group.name: group for group in summarise(rows)}
    for noise in NOISES:
        group = groups[f"{100 * noise:g} % noise"]
        met = group.right >= SEGMENTS[noise] and round(group.ratio, 2) <= RATIO[noise]
        found = f"{100 * group.right:.2f} % of segments, median ratio {group.ratio:.3f}, {100 * group.perfect:.0f} %"
        yield Verdict(f"{group.name} ({SEGMENTS[noise]:.0%}, {RATIO[noise]:g}): {found} of runs perfect", met)
    yield alarm([groups[name] for name in FAILURES])


def alarm(groups: Sequence[Group]) -> Verdict:
    """How many of the failures are flagged."""
    wrong, told = sum(group.wrong for group in groups), sum(group.alarms for group in groups)
    return Verdict(f"alarm in {told} of {wrong} runs that fail on purpose ({ALARMS:.0%})", told >= ALARMS * wrong)


def of_constants(kinds: Sequence[Kind]) -> Iterator[Verdict]:
    """How far off the constants are; reports, not targets."""
    for kind in kinds:
        errors = f"off by {100 * kind.median:.1f} % (median), {100 * kind.largest:.1f} % (largest)"
        yield Verdict(f"torque constants, {kind.name}: {errors}, {kind.refused} of {kind.arms} arms refused", None)


def of_bins(bins: Sequence[Bin]) -> Verdict:
    """Whether a sure segment is ever wrong."""
    sure = [one for one in bins if one.low >= SURE]
    total, right = sum(one.segments for one in sure), sum(one.right for one in sure)
    return Verdict(f"{total - right} of {total} segments with p >= {SURE:g} and no flag are wrong (0)", total == right)


def of_all(rows: Sequence[Row]) -> Verdict:
    """How often a flag is raised where all is right, and none where something is wrong; a report, not a target."""
    wrong = [row for row in rows if is_wrong(row)]
    silent, false = sum(not row.flags for row in wrong), sum(bool(row.flags) for row in rows if not is_wrong(row))
    told = f"{silent} of {len(wrong)} wrong runs are not flagged, {false} of {len(rows) - len(wrong)} right ones are"
    return Verdict(told, None)


def of_hobby(report: Report) -> Verdict:
    """Whether certainty is claimed that was not earned."""
    sure, count = sum(told.sure for told in report.joints), len(report.flags)
    return Verdict(f"SO-101: {sure} segments with p >= .999, {count} flags (no certainty without a flag)", report.holds)
