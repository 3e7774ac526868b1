"""The clock of a recording, its usable stretches, and its samples on a uniform grid."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from test_recording import arm
from test_recording_formats import refusal, sentence

from signid.recording import read_recording
from signid.recording.sampling import Sampling, one_after_another, samples, split, survey
from signid.types import Recording, Robot, Samples

Columns = dict[str, np.ndarray]
ROBOT = arm("shoulder", "elbow")


def motion(t: np.ndarray) -> Columns:
    """Two joints that move."""
    q = np.column_stack([np.sin(1.3 * t) + 0.2 * np.sin(4 * t), 0.5 * np.cos(0.9 * t)])
    return {"t": t, "q": q, "tau": np.column_stack([3 * np.cos(1.7 * t), np.sin(t) - 0.2])}


def jittered(n: int, period: float = 0.01, share: float = 0.4) -> np.ndarray:
    return np.cumsum(period * (1 + share * np.random.default_rng(3).uniform(-1, 1, n)))


def surveyed(columns: Columns, robot: Robot = ROBOT, **options: Any) -> tuple[Recording, Sampling]:
    recording = read_recording(columns, robot, **options)
    return recording, survey(recording, robot)


def everything(recording: Recording, sampling: Sampling, span: int = 0) -> Samples:
    chosen = sampling.spans[span]
    return samples(recording, sampling, chosen, 0, sampling.length(chosen))


def small_blocks(monkeypatch: pytest.MonkeyPatch, stride: int, chunk: int) -> None:
    """Small blocks, as if files were longer."""
    for module in ("grid", "accumulate"):
        monkeypatch.setattr(sys.modules[f"signid.recording.sampling.{module}"], "STRIDE", stride)
    for module in ("survey", "clock"):
        monkeypatch.setattr(sys.modules[f"signid.recording.sampling.{module}"], "CHUNK", chunk)


def test_uniform_rows_are_the_grid() -> None:
    columns = motion(np.arange(1000) * 0.004)
    recording, sampling = surveyed(columns)
    found = everything(recording, sampling)
    assert sampling.uniform and sampling.spans == ((0, 1000),) and not sampling.notes and sampling.rows == 1000
    assert sampling.period == pytest.approx(0.004) and sampling.duration == pytest.approx(3.996)
    np.testing.assert_array_equal(found.q, columns["q"])
    np.testing.assert_array_equal(found.tau, columns["tau"])
    np.testing.assert_allclose(found.t, columns["t"], atol=1e-12)
    np.testing.assert_array_equal(sampling.lower, columns["q"].min(0))
    np.testing.assert_array_equal(sampling.upper, columns["q"].max(0))
    np.testing.assert_allclose(sampling.torque_rms, np.sqrt(np.mean(columns["tau"] ** 2, axis=0)))
    speed = np.gradient(columns["q"], 0.004, axis=0)
    np.testing.assert_allclose(sampling.speed, np.sqrt(np.mean(speed**2, axis=0)), rtol=0.02)


@pytest.mark.parametrize("digits", [3, 5, 7])
def test_rounded_stamps_of_a_steady_clock_are_uniform(digits: int) -> None:
    t = np.arange(5000) / 240
    recording, sampling = surveyed(motion(np.round(t, digits)))
    assert sampling.uniform and sampling.period == pytest.approx(1 / 240, rel=1e-5)
    np.testing.assert_allclose(everything(recording, sampling).t, t, atol=10.0**-digits)


@pytest.mark.parametrize("start", [-50.0, 0.0, 1.7e9])
def test_any_origin_of_time(start: float) -> None:
    steady = surveyed(motion(start + np.arange(3000) * 0.002))[1]
    assert steady.uniform and steady.period == pytest.approx(0.002, rel=1e-6)
    assert not surveyed(motion(start + jittered(3000, 0.002)))[1].uniform


def test_clocks_that_are_not_uniform() -> None:
    t = np.arange(3000) * 0.01
    ticks = 0.002 * np.round(np.arange(3000) * 0.0106667 / 0.002)  # 10, 10, 12 ms, as of a UR10e
    drifting = 0.01 * np.cumsum(1 + 0.02 * np.sin(np.arange(3000) / 500))
    for uneven in (jittered(3000), ticks, drifting, np.where(t > 15, t + 0.004, t)):
        sampling = surveyed(motion(uneven))[1]
        assert not sampling.uniform and len(sampling.spans) == 1
        assert sampling.period == pytest.approx(np.median(np.diff(uneven)))
        assert sampling.jitter == pytest.approx((np.diff(uneven).min(), np.diff(uneven).max()))
        sentence(sampling.notes[0], "resampled", f"{sampling.period * 1e3:.6g} ms")


def test_interpolation_is_exact_for_parabolas_and_of_third_order() -> None:
    t = jittered(2000)
    columns = {"t": t, "q": np.column_stack([0.1 + 0.2 * t - 0.01 * t**2, 0 * t]), "tau": np.column_stack([t**2, t])}
    found = everything(*surveyed(columns, arm("shoulder", "elbow")))
    np.testing.assert_allclose(found.q[:, 0], 0.1 + 0.2 * found.t - 0.01 * found.t**2, atol=1e-12)
    np.testing.assert_allclose(found.tau, np.column_stack([found.t**2, found.t]), atol=1e-10)
    errors = []
    for period in (0.02, 0.01):
        found = everything(*surveyed(motion(jittered(int(20 / period), period))))
        inner = slice(3, -3)
        errors.append(np.abs(found.q - motion(found.t)["q"])[inner].max())
        assert np.ptp(np.diff(found.t)) < 1e-12
    assert errors[1] < 1e-6 and errors[0] / errors[1] > 6  # 8 at third order


def test_absolute_torques_stay_positive() -> None:
    columns = motion(jittered(2000))
    columns["tau"][::7] = 0.0
    recording, sampling = surveyed(columns, unsigned=True)
    assert everything(recording, sampling).tau.min() == 0.0
    assert everything(*surveyed(columns)).tau.min() < 0


def rough() -> Columns:
    """Jitter, duplicates, gaps, holes, a joint that turns round and round, and columns that are not always there."""
    t = jittered(4000, share=0.1)
    t[[70, 71, 1500, 2600]] = t[[69, 69, 1499, 2599]]
    t[1000:] += 0.3
    columns = motion(t)
    columns["q"][:, 1] = (2.1 * t + np.sin(t) + np.pi) % (2 * np.pi) - np.pi
    columns["q"][2000:2006] = np.nan
    columns["tau"][3000:3006, 0] = np.nan
    columns["q_des_2"] = (columns["q"][:, 1] + 0.2 + np.pi) % (2 * np.pi) - np.pi
    return columns


SPINNING = replace(ROBOT, lower=np.array([-3.0, -np.inf]), upper=np.array([3.0, np.inf]))


@settings(max_examples=12)
@given(cuts=st.lists(st.integers(0, 990), max_size=6), stride=st.sampled_from([5, 16, 100]))
def test_samples_do_not_depend_on_how_they_are_asked_for(cuts: list[int], stride: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        small_blocks(patch, stride, 1000)
        recording, sampling = surveyed(rough(), SPINNING)
        for k, span in enumerate(sampling.spans):
            whole = everything(recording, sampling, k)
            bounds = sorted({0, *(c for c in cuts if c < len(whole.t)), len(whole.t)})
            pieces = [samples(recording, sampling, span, a, b) for a, b in zip(bounds, bounds[1:], strict=False)]
            assert {piece.origin for piece in pieces} == {whole.origin}
            for key, values in whole._asdict().items():
                if values is not None and key != "origin":
                    np.testing.assert_array_equal(np.concatenate([getattr(piece, key) for piece in pieces]), values)


def test_spans_do_not_depend_on_chunks() -> None:
    found = []
    for chunk in (65_536, 700, 33):
        with pytest.MonkeyPatch.context() as patch:
            small_blocks(patch, 4096, chunk)
            sampling = surveyed(rough(), SPINNING)[1]
        found.append((sampling.spans, sampling.rows, sampling.duplicates, sampling.turn_rows.tolist(), sampling.jitter))
        assert sampling.spans == ((0, 1000), (1000, 2000), (2006, 3000), (3006, 4000))
    assert found[0] == found[1] == found[2]


def test_omitted_samples_are_reported() -> None:
    sampling = surveyed(rough(), SPINNING)[1]
    text = " / ".join(sampling.notes)
    for note in sampling.notes:
        sentence(note)
    for words in (
        "1 gap",
        "0.3",
        "6 in q_1",
        "6 in tau_1",
        "12 samples of 4000 omitted",
        "4 samples dropped",
        "q_2 wraps",
    ):
        assert words in text, (words, text)


def test_turning_joints_are_unwrapped() -> None:
    recording, sampling = surveyed(rough(), SPINNING)
    for k in range(len(sampling.spans)):
        found = everything(recording, sampling, k)
        assert np.abs(np.diff(found.q[:, 1])).max() < 0.1 and found.q_des is not None
        np.testing.assert_allclose(found.q_des[2:-2, 1] - found.q[2:-2, 1], 0.2, atol=1e-6)
        assert sampling.lower[1] - 1e-4 <= found.q[:, 1].min() and found.q[:, 1].max() <= sampling.upper[1] + 1e-4
    assert sampling.upper[1] - sampling.lower[1] > 3 * np.pi


def test_duplicates_of_a_uniform_recording_are_dropped() -> None:
    columns = motion(np.arange(1000) * 0.004)
    twice = {name: np.insert(x, [5, 5, 400], x[[4, 4, 399]], axis=0) for name, x in columns.items()}
    twice["q"][5] = 99.0
    recording, sampling = surveyed(twice)
    assert sampling.uniform and sampling.duplicates == 3 and sampling.rows == 1000
    np.testing.assert_array_equal(everything(recording, sampling).q, columns["q"])
    for start in (3, 4, 5, 6, 399, 400, 401):
        piece = samples(recording, sampling, (0, 1003), start, start + 2)
        np.testing.assert_array_equal(piece.q, columns["q"][start : start + 2])


def test_splitting_keeps_the_grid() -> None:
    for t in (np.arange(3000) * 0.01, jittered(3000)):
        recording, sampling = surveyed(motion(t))
        first, last = split(sampling, 0.7)
        assert abs(first.length(first.spans[0]) / sampling.length(sampling.spans[0]) - 0.7) < 1e-3
        assert first.spans[0][1] == last.spans[0][0] and first.duration + last.duration < sampling.duration
        for name in ("t", "q", "tau"):
            both = [getattr(everything(recording, part), name) for part in (first, last)]
            np.testing.assert_array_equal(np.concatenate(both), getattr(everything(recording, sampling), name))
    recording, sampling = surveyed(rough(), SPINNING)
    first, last = split(sampling, 0.5)
    assert len(first.spans) == len(last.spans) == 2 or len(first.spans) + len(last.spans) == 5
    with refusal("too short"):
        split(surveyed(motion(np.arange(80) * 0.01))[1], 0.9)
    with pytest.raises(KeyError):
        sampling.length((1, 2))


def _named(robot: Robot, start: float, seconds: float = 10.0) -> Sampling:
    t = start + np.arange(0, seconds, 0.01)
    q = np.column_stack([np.sin(t + k) for k in range(len(robot.joints))])
    return survey(read_recording({"t": t, "q": q, "tau": q}, robot), robot)


@pytest.mark.parametrize(
    ("starts", "origins"),
    [
        ((0.0, 0.0, 0.5), (0.0, -10.0, -19.5)),  # begins again in each file
        ((0.0, 12.0, 30.0), (0.0, 0.0, 0.0)),  # goes on
        ((1.7e9, 1.7e9 + 60, 1.7e9 + 600), (1.7e9, 1.7e9, 1.7e9)),
        ((1.7e9, 1.7e9 + 86400), (1.7e9, 1.7e9 + 86400)),  # the next day
    ],
)
def test_time_of_a_session_counts_from_its_first_recording(
    starts: tuple[float, ...], origins: tuple[float, ...]
) -> None:
    robot = arm()
    found = one_after_another([_named(robot, start) for start in starts])
    assert [one.origin for one in found] == pytest.approx(origins, abs=0.02)
