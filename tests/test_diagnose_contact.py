"""Contact windows on small evidence: found where a force acts, and nowhere else."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from diagnosis_rows import RATE, Question, law, names, pose

from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.search.iterate import _with_contact
from signid.diagnose.search.shapes import MIN_WINDOW_ROWS, _best, find_contact
from signid.diagnose.thresholds import CONTACT_WIDTHS
from signid.types import Array

FORCE = {"force_x": 2.0, "force_y": -1.0, "force_z": 3.0}
LIBRARY = (law("viscous_friction"), law("spring", 1))


@cache
def question(start: float, end: float, size: float = 1.0, recordings: int = 1) -> Question:
    """A force in the same seconds of each recording."""
    force = {key: size * x for key, x in FORCE.items()}
    return pose(
        LIBRARY, law("external_contact", 0, 1, 2, start=start, end=end, **force), robot="3r", recordings=recordings
    )


def found(one: Question, residual: Array | None = None) -> Hypothesis | None:
    data = one.posterior.evidence.data
    return find_contact(one.dataset, data, data.residual if residual is None else residual, one.dispersion)


@pytest.mark.parametrize(("start", "end"), [(3.03, 4.41), (1.0, 5.0), (5.0, 5.6), (6.2, 7.9)])
def test_a_contact_is_found_where_it_is(start: float, end: float) -> None:
    window = found(question(start, end))
    assert window is not None and window.laws[0].joints == (0, 1, 2)
    assert window.laws[0].parameters["start"] == pytest.approx(start, abs=2 / RATE)
    assert window.laws[0].parameters["end"] == pytest.approx(end, abs=2 / RATE)


@pytest.mark.parametrize("recording", [0, 1])
def test_the_right_recording_is_found(recording: int) -> None:
    one = question(3.03, 4.41, recordings=2)
    table, data = one.dataset.table, one.posterior.evidence.data
    only = np.where(data.recording == recording, data.residual, 0.0)
    window = found(one, only)
    assert window is not None and set(table.recording) == {0, 1}
    columns = one.dataset.columns(window)[1]  # zero outside the window, which is of the same seconds in both
    assert np.any(columns[table.recording == recording])


def test_no_contact_is_found_in_noise() -> None:
    quiet = question(3.0, 4.0, 0.0)
    assert found(quiet, np.zeros_like(quiet.posterior.evidence.data.residual)) is None
    selection = quiet.selection()
    assert _with_contact(quiet.dataset, selection) is selection


def test_a_faint_contact_is_not_selected_and_a_clear_one_is() -> None:
    faint, clear = question(3.03, 4.41, 0.002), question(3.03, 4.41)
    assert "external_contact" not in names(_with_contact(faint.dataset, faint.selection()))
    after = _with_contact(clear.dataset, clear.selection())
    assert names(after) == {"external_contact"}
    fit = after.fit()
    np.testing.assert_allclose(fit.value[fit.place(after.selected[0])], list(FORCE.values()), rtol=0.1)


def test_a_contact_does_not_displace_a_law() -> None:
    contact = law("external_contact", 0, 1, 2, start=3.03, end=4.41, **FORCE)
    one = pose(LIBRARY, contact, law("spring", 1, stiffness=1.5, rest=0.2), robot="3r")
    after = _with_contact(one.dataset, one.selection(one.group("spring", 1)))
    assert names(after) == {"external_contact", "spring"}


def test_the_best_window_has_the_best_evidence_of_all() -> None:
    """Compare with the Bayes factor of every window from dense normal densities."""
    rng, variance, rate = np.random.default_rng(3), 0.5, 10.0
    x, count = rng.standard_normal((60, 3)), 60
    y = rng.standard_normal(count)
    y[20:34] += x[20:34] @ [1.0, -0.5, 0.7]
    square = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(x[:, :, None] * x[:, None], axis=0)])
    right = np.concatenate([np.zeros((1, 3)), np.cumsum(x * y[:, None], axis=0)])
    best = _best(square, right, variance, rate)

    def log_bayes(start: int, stop: int) -> float:
        own = np.eye(stop - start) + variance * x[start:stop] @ x[start:stop].T
        misfit = y[start:stop] @ (y[start:stop] - np.linalg.solve(own, y[start:stop]))
        return float(misfit / 2 - np.linalg.slogdet(own)[1] / 2)

    near = [log_bayes(best.start + k, best.stop + m) for k in (-1, 0, 1) for m in (-1, 0, 1)]
    assert best.log_bayes == pytest.approx(log_bayes(best.start, best.stop)) == pytest.approx(max(near))
    assert abs(best.start - 20) <= 2 and abs(best.stop - 34) <= 2
    assert best.log_bayes >= max(log_bayes(k, k + int(width * rate)) for width in CONTACT_WIDTHS[:3] for k in range(20))
    assert best.stop - best.start >= MIN_WINDOW_ROWS


def test_a_contact_makes_torque_in_its_window_alone() -> None:
    one = question(3.03, 4.41)
    window = found(one)
    assert window is not None
    motion = one.dataset.pieces[0].motion
    inside = (motion.t >= window.laws[0].parameters["start"]) & (motion.t <= window.laws[0].parameters["end"])
    for columns in window.columns(motion).values():
        assert not np.any(columns[~inside]) and np.any(columns[inside])
