"""Stamps that go back a little, or have too few digits: times whose values are known, and what is still refused."""

from __future__ import annotations

import numpy as np
import pytest

import signid
from signid.errors import RecordingError
from signid.recording.sampling import survey

ROBOT = signid.load_robot("3r")
Columns = dict[str, np.ndarray]


def log(t: np.ndarray, stamps: np.ndarray) -> Columns:
    """Rows at t [s] with these stamps [s]."""
    phase = np.outer(t, [1.3, 2.1, 2.9])
    kinds = (("q", np.sin(phase) + 0.3 * np.sin(2.7 * phase)), ("tau", 5 * np.cos(phase)))
    return {"t": stamps, **{f"{kind}_{j + 1}": x[:, j] for kind, x in kinds for j in range(3)}}


def times(columns: Columns, word: str) -> np.ndarray:
    """Times of the rows that are read, from 0 [s]; a note has the word, and the clock needs no other repair."""
    found = signid.read_recording(columns, ROBOT)
    assert [note for note in found.notes if word in note], found.notes
    sampling = survey(found, ROBOT)
    assert sampling.uniform and not [note for note in sampling.notes if "jitter" in note or "dropped" in note]
    t = found.read().t
    return np.asarray(t - t[0])


@pytest.mark.parametrize(("hertz", "digits"), [(500, 2), (125, 2), (300, 2), (1000, 2), (2000, 3)])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_stamps_with_too_few_digits_are_spaced_by_their_rate(hertz: float, digits: int, start: float) -> None:
    t = np.arange(0, 20, 1 / hertz)
    found = times(log(t, np.round(start + t, digits)), f"by the rate that they imply, {hertz} Hz")
    np.testing.assert_allclose(found, t, atol=0.05 * 10.0**-digits)
    t = np.r_[t[t < 8], t[t >= 11]]
    found = times(log(t, np.round(start + t, digits)), "too few digits")
    np.testing.assert_allclose(found, t, atol=10.0**-digits)


@pytest.mark.parametrize("jitter", [0.35, 0.5])
def test_stamps_that_jitter_back_keep_the_order_of_rows(jitter: float) -> None:
    t = np.arange(0, 20, 0.01)
    stamps = 1.7e9 + t + jitter * 0.01 * np.random.default_rng(0).standard_normal(len(t))
    assert (np.diff(stamps) < 0).any()
    np.testing.assert_allclose(times(log(t, stamps), "are kept in their order"), t, atol=2e-3)


def test_rows_that_a_logger_exchanged_are_sorted() -> None:
    t = np.arange(0, 20, 0.01)
    rows, columns = np.arange(len(t)), log(t, t)
    for k in range(20, len(t) - 2, 37):
        rows[[k, k + 1]] = rows[[k + 1, k]]
    mixed = {name: x[rows] for name, x in columns.items()}
    np.testing.assert_allclose(times(mixed, "rows are sorted by time"), t, atol=1e-12)
    samples = signid.read_recording(mixed, ROBOT).read()
    np.testing.assert_array_equal(samples.q[:, 0], columns["q_1"])
    np.testing.assert_array_equal(samples.tau[:, 2], columns["tau_3"])


@pytest.mark.parametrize("fault", ["a clock that is set back", "rows that are written twice"])
def test_other_faults_are_still_refused(fault: str) -> None:
    t = np.arange(0, 20, 0.01)
    twice = np.repeat(t, 2)
    columns = log(twice, twice) if "twice" in fault else log(t, t - 5.0 * (t > 10))
    with pytest.raises(RecordingError, match="repeat the time" if "twice" in fault else "time goes back"):
        survey(signid.read_recording(columns, ROBOT), ROBOT)
