"""An identification as a page for the browser: fit, base parameters, laws, bodies, excitation, signs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ....diagnose.extend.holdout import course_of, residual_rows
from ....estimation.excitation import ENOUGH
from ....estimation.fit_quality import Course, Fit
from ....identify import Identification
from ....model import Model, stated_inertials, stated_laws
from ....recording.sampling import split
from ....regression.session import Part, Session
from ....types import TWO_SIDED, Array, Input, pseudo_inertia
from ....version import __version__
from ..layout import plural
from ..numbers import determination, figure, share, with_interval
from ..quantities import law_numbers
from ..results.documents import description, once
from ..results.signs import proof_sentence
from ..results.tables import consistent_words, excited_words
from .correlation import correlation_plot, tied
from .courses import joint_plots, worst
from .diagnosis import Card
from .frame import AFTER, FLOOR, Plot, axis, packed, render
from .signs import sign_plots

LISTED = 12  # pairs of parameters that are named
MOST, FEW = 400_000, 20_000  # samples that are drawn, and that are not worth a part of a recording


class Bound(NamedTuple):
    """A base parameter as a line of a table."""

    number: int
    name: str
    value: str
    half: str
    unit: str
    percent: float | None  # half width over value [%]


def identification_page(result: Identification, inputs: Sequence[Input] = (), command: str = "") -> str:
    """A page that needs nothing else; the same identification gives the same bytes.

    Args:
        result: the identification.
        inputs: what was read besides the recordings; the robot's description if none is given.
        command: that makes the page again, if there is one.
    """
    session, base = result.session, result.base
    course, whole = _course(session, result.model) if session.held_out else (None, True)
    order = worst(result.fit)
    before = None if course is None else replace(result.fit, held_out_rms=_rms(course.before))
    return render(
        "identification.html",
        title=f"{result.robot.name}: {plural(base.rank, 'base parameter')}",
        robot=result.robot.name,
        sentence=_sentence(result),
        flags=result.flags,
        cards=list(_cards(result, order[0])),
        fit=list(_fit_rows(result, before)),
        joints=[] if course is None or before is None else joint_plots(course, before, result.fit, order),
        whole=whole,
        bounds=_bounds(result),
        correlation=correlation_plot(result.estimate.covariance),
        tied=[(base.expressions[i], base.expressions[k], x) for i, k, x in tied(result.estimate.covariance)[:LISTED]],
        laws=list(_laws(result)),
        links=list(_links(result)),
        consistent=consistent_words(result),
        excited=excited_words(result.excitation),
        excitation=_excitation_plot(result),
        signs=_signs(result),
        notes=result.notes,
        cutoff=result.cutoff,
        method=f"{result.estimate.method}, {result.method}",
        files=once([*result.inputs, *(inputs or [description(result.robot)])]),
        command=command,
        seed=result.seed,
        version=__version__,
    )


def _course(session: Session, after: Model) -> tuple[Course, bool]:
    """The description and the model on what was held out, or on its beginning, and whether that is all of it."""
    parts = list(_beginning(session.held_out))
    stated = Model(session.robot, stated_inertials(session.robot), stated_laws(session.robot))
    before, learned = (residual_rows(session.task, model, parts) for model in (stated, after))
    return course_of(before, learned, session.robot), _samples(parts) == _samples(session.held_out)


def _beginning(parts: Sequence[Part]) -> Iterator[Part]:
    """Recordings one after the other, the last of them in part, until there are enough samples."""
    left = MOST
    for part in parts:
        count, (recording, sampling) = _samples([part]), part
        if count > left:
            yield recording, split(sampling, left / count)[0]
            return
        yield part
        left -= count
        if left < FEW:
            return


def _samples(parts: Sequence[Part]) -> int:
    return sum(sampling.length(span) for _, sampling in parts for span in sampling.spans)


def _sentence(result: Identification) -> str:
    r2 = result.fit.held_out_r2[np.isfinite(result.fit.held_out_r2)]
    told = f"; held out, R2 {determination(float(r2.min()))} at least" if len(r2) else ""
    count = plural(len(result.robot.joints), "joint")
    return f"{plural(result.base.rank, 'base parameter')} of {count}{told}"


def _cards(result: Identification, j: int) -> Iterator[Card]:
    fit = result.fit
    rms, floor = (float(x[j]) for x in (fit.held_out_rms, fit.noise_floor))
    beside = f"the worst joint; noise floor {figure(floor, 2)} {fit.unit[j]}"
    yield Card(f"torque left unexplained at {fit.joints[j]}, held out", f"{figure(rms)} {fit.unit[j]}", beside)
    shares = result.excitation.shares
    least = share(max(float(shares[0]), 0.0)) if len(shares) else "-"
    yield Card("excitation, weakest direction", least, f"{share(ENOUGH)} of random motion's information is needed")
    yes = "possible" if result.physically_consistent else "impossible"
    yield Card("a real robot with these inertials is", yes, f"moved by {result.moved:.1f} standard deviations at most")


def _rms(rest: Array) -> Array:
    told = np.isfinite(rest)
    mean = np.sum(np.where(told, rest, 0.0) ** 2, axis=0) / np.maximum(told.sum(axis=0), 1)
    return np.where(told.any(axis=0), np.sqrt(mean), np.nan)


def _fit_rows(result: Identification, before: Fit | None) -> Iterator[tuple[str, ...]]:
    """Joint, rms as described where samples tell it, in training and held out, noise floor, unit, R2."""
    fit = result.fit
    rms = (*([] if before is None else [before.held_out_rms]), fit.train_rms, fit.held_out_rms)
    for j, joint in enumerate(fit.joints):
        told = (figure(float(x[j])) for x in rms)
        floor, r2 = figure(float(fit.noise_floor[j]), 2), determination(float(fit.held_out_r2[j]))
        yield joint, *told, floor, fit.unit[j], r2


def _bounds(result: Identification) -> list[Bound]:
    """Every base parameter with its interval."""
    bounds = []
    for k, (name, unit) in enumerate(zip(result.base.expressions, result.base.units, strict=True)):
        value, std = float(result.base_value[k]), float(result.estimate.std[k])
        told, half = with_interval(value, std)
        percent = 100 * TWO_SIDED * std / abs(value) if value and np.isfinite(std) else None
        bounds.append(Bound(k + 1, name, told, half, unit, percent))
    return bounds


def _laws(result: Identification) -> Iterator[tuple[str, str, str, str, str, str]]:
    for numbers in law_numbers(result):
        for n in numbers:
            told = (figure(n.value), "in combination") if n.std is None else with_interval(n.value, n.std)
            yield n.joint or "(robot)", n.effect.replace("_", " "), n.key.replace("_", " "), *told, n.unit


def _links(result: Identification) -> Iterator[tuple[str, ...]]:
    """Mass, centre of mass and smallest eigenvalue of the pseudo-inertia of each link, as described and identified."""
    for link, stated, found in zip(
        result.robot.links, stated_inertials(result.robot), result.parameters.bodies(), strict=True
    ):
        least = float(np.linalg.eigvalsh(pseudo_inertia(found))[0])
        centres = (_centre(inertial) for inertial in (stated, found))
        yield link, figure(float(stated[0])), figure(float(found[0])), *centres, figure(least, 2)


def _centre(inertial: Array) -> str:
    """Of a centre of mass [mm]; what is less than a nanometre is rounding."""
    mass = float(inertial[0])
    return ", ".join(figure(round(1e3 * float(x) / mass, 6)) for x in inertial[1:4]) if mass else "-"


def _excitation_plot(result: Identification) -> Plot:
    """Share of each direction, ascending, and how much is needed."""
    shares = np.maximum(result.excitation.shares, 1e-6)
    number = np.arange(1.0, len(shares) + 1)
    bars = {
        "type": "bar",
        "x": packed(number),
        "y": packed(100 * shares),
        "marker": {"color": AFTER},
        "hovertemplate": "direction %{x}: %{y:.3g} %<extra></extra>",
    }
    ends = [0.5, len(shares) + 0.5]
    line = {"type": "scatter", "mode": "lines", "x": ends, "y": [100 * ENOUGH] * 2, "hoverinfo": "skip"}
    layout = {
        "xaxis": axis("direction, the weakest first [1]"),
        "yaxis": axis("share of information [%]", type="log", tickformat="~g"),
    }
    dashed = {"color": FLOOR, "dash": "dash", "width": 2}
    data: list[dict[str, Any]] = [bars, {**line, "line": dashed}]
    return Plot(
        "Directions in the space of base parameters: information over that of random motion; dashed: needed",
        data,
        layout,
        260,
        wide=True,
    )


def _signs(result: Identification) -> dict[str, Any] | None:
    if result.signs is None:
        return None
    units = ["N" if prismatic else "N.m" for prismatic in result.robot.prismatic]
    return {"proof": proof_sentence(result.signs), "parts": sign_plots(result.signs, units)}
