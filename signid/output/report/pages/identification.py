"""Page of an identification: fit, base parameters, laws, bodies, excitation, signs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ....diagnose.extend.holdout import course_of, residual_rows
from ....estimation.excitation import ENOUGH
from ....estimation.fit_quality import Course
from ....identify import Identification
from ....model import Model, stated_inertials, stated_laws
from ....recording.sampling import split
from ....regression.session import Part, Session
from ....types import TWO_SIDED, Array, Input, pseudo_inertia
from ..documents import rms
from ..layout import determination, figure, plural, share, torque_units, with_interval
from ..plots.courses import joint_plots, worst
from ..plots.frame import AFTER, FLOOR, axis, packed, render, shared
from ..plots.heat import correlation_plot, tied
from ..policy import plot_markup
from ..results.identification import consistent_words, excited_words, fit_rows, identified_numbers
from ..results.signs import proof_sentence
from ..sections import Card, Plot
from .signs import sign_plots

LISTED = 12  # maximum number of correlated pairs listed
MOST = 400_000  # maximum number of samples drawn
FEW = 20_000  # number of samples below which no further part of a recording is drawn


def identification_page(result: Identification, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of an identification; `inputs` besides the recordings default to the description."""
    session, base = result.session, result.base
    course, whole = held_out_rows(session, result.judged) if session.held_out else (None, True)
    order, r2 = worst(result.fit), result.fit.held_out_r2[np.isfinite(result.fit.held_out_r2)]
    quality = f"; held-out R2 at least {determination(r2.min())}" if len(r2) else ""
    before = None if course is None else replace(result.fit, held_out_rms=rms(course.before))
    return render(
        "identification.html",
        title=f"{result.robot.name}: {plural(base.rank, 'base parameter')}",
        sentence=f"{plural(base.rank, 'base parameter')} of {plural(len(result.robot.joints), 'joint')}{quality}",
        cards=[card for card in _cards(result, order[0]) if "-" not in card.figure.split()],
        fit=list(fit_rows(result.fit, *([] if before is None else [before.held_out_rms]))),
        joints=[] if course is None or before is None else joint_plots(course, before, result.fit, order),
        whole=whole,
        bounds=list(_bounds(result)),
        correlation=correlation_plot(result.estimate.covariance),
        tied=[(base.expressions[i], base.expressions[k], x) for i, k, x in tied(result.estimate.covariance)[:LISTED]],
        laws=[(n.place, *n.words, *n.interval, n.unit) for numbers in identified_numbers(result) for n in numbers],
        links=list(_links(result)),
        consistent=consistent_words(result),
        excited=excited_words(result.excitation),
        excitation=excitation_plot(result),
        proof=result.signs and proof_sentence(result.signs),
        parts=result.signs and sign_plots(result.signs, torque_units(result.robot)),
        method=f"{result.estimate.method}, {result.method}",
        **shared(result, [result.robot], inputs, command),
    )


def held_out_rows(session: Session, after: Model) -> tuple[Course, bool]:
    """Residuals of the description and the model on held-out data or its beginning; whether that is all of it."""
    parts = list(_beginning(session.held_out))
    stated = Model(session.robot, stated_inertials(session.robot), stated_laws(session.robot))
    before, identified = (residual_rows(session.task, model, parts) for model in (stated, after))
    return course_of(before, identified, session.robot), _samples(parts) == _samples(session.held_out)


def _beginning(parts: Sequence[Part]) -> Iterator[Part]:
    """Yield recordings until there are enough samples, the last one in part."""
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


def _cards(result: Identification, j: int) -> Iterator[Card]:
    fit = result.fit
    beside = f"worst joint; noise floor {figure(fit.noise_floor[j], 2)} {fit.unit[j]}"
    size = f"{figure(fit.held_out_rms[j])} {fit.unit[j]}"
    yield Card(f"residual torque of {fit.joints[j]}, held out", size, beside)
    shares = result.excitation.shares
    least = share(max(float(shares[0]), 0.0)) if len(shares) else "-"
    yield Card("excitation, weakest direction", least, f"{share(ENOUGH)} of the information of random motion needed")
    verdict = "consistent" if result.physically_consistent else "inconsistent"
    yield Card("physical consistency", verdict, f"changed by at most {result.moved:.1f} standard deviations")


def _bounds(result: Identification) -> Iterator[dict[str, Any]]:
    """Base parameters with their intervals, and the half-width over the value [%]."""
    columns = (result.base.expressions, result.base.units, result.base_value.tolist(), result.estimate.std.tolist())
    for number, (name, unit, value, std) in enumerate(zip(*columns, strict=True), 1):
        shown, half = with_interval(value, std)
        percent = 100 * TWO_SIDED * std / abs(value) if value and np.isfinite(std) else None
        yield {"number": number, "name": name, "value": shown, "half": half, "unit": unit, "percent": percent}


def _links(result: Identification) -> Iterator[tuple[str, ...]]:
    """Described and identified mass and centre of mass, and smallest eigenvalue of the pseudo-inertia, per link."""
    columns = (result.robot.links, stated_inertials(result.robot), result.parameters.bodies())
    for link, stated, found in zip(*columns, strict=True):
        least = float(np.linalg.eigvalsh(pseudo_inertia(found))[0])
        centres = (_centre(inertial) for inertial in (stated, found))
        yield link, figure(float(stated[0])), figure(float(found[0])), *centres, figure(least, 2)


def _centre(inertial: Array) -> str:
    """Format a centre of mass [mm]; less than a nanometre is rounding error."""
    mass = float(inertial[0])
    return ", ".join(figure(round(1e3 * float(x) / mass, 6)) for x in inertial[1:4]) if mass else "-"


def excitation_plot(result: Identification) -> Plot:
    """Plot the share of information per direction, ascending, and the required share."""
    shares = np.maximum(result.excitation.shares, 1e-6)
    number = np.arange(1.0, len(shares) + 1)
    bars = {
        "type": "bar",
        "x": packed(number),
        "y": packed(100 * shares),
        "marker": {"color": AFTER},
        "hovertemplate": plot_markup("direction %{x}: %{y:.3g} %<extra></extra>"),
    }
    ends = [0.5, len(shares) + 0.5]
    line = {"type": "scatter", "mode": "lines", "x": ends, "y": [100 * ENOUGH] * 2, "hoverinfo": "skip"}
    layout = {
        "xaxis": axis("direction, weakest first [1]"),
        "yaxis": axis("share of information [%]", type="log", tickformat="~g"),
    }
    dashed = {**line, "line": {"color": FLOOR, "dash": "dash", "width": 2}}
    title = "Directions in parameter space: information relative to random motion; dashed: required"
    return Plot(title, [bars, dashed], layout, 260, wide=True)
