"""Numbers of drives that differ between recordings are named, and intervals contain the spread."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from numpy.testing import assert_allclose
from servo_loops import SWING, driven, motion, pendulum

from signid.output.report.results.servo_identification import servo_identification_document
from signid.recording import read_recording
from signid.servo.fit import ServoFit, fit_servos
from signid.servo.fit.normal import Certainty, Normal, certainty, covariance
from signid.servo.identify import ServoOptions, identify_servos
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servos import ServoGrid
from signid.types import Array, Indices

SPREAD = 0.03  # [N.m] standard deviation of the torque offset between recordings
FREE = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")
START = SWING.with_(kd=SWING.damping, viscous_friction=0.0)  # one number


def repeats(spread: float, seed: int, count: int = 4) -> list[ServoGrid]:
    """Recordings of a pendulum whose drive has another torque offset in each."""
    rng, found = np.random.default_rng(seed), list[ServoGrid]()
    for k in range(count):
        servo = SWING.with_(torque_offset=SWING.torque_offset + spread * rng.standard_normal())
        model = driven(pendulum(), {"swing": servo})
        fine = motion(model, 100 * seed + k, 12.0)
        q = roll_out(model, {"swing": servo}, fine)[::10]
        q, t = q + 3e-4 * rng.standard_normal(q.shape), np.arange(len(fine))[::10] / fine.rate
        found.append(grids_of_arrays(fine.joints, t, q, fine.command[::10], rate=100.0, path=f"{k}.csv")[0])
    return found


def fitted(grids: list[ServoGrid]) -> ServoFit:
    """Drive of the pendulum."""
    return fit_servos(driven(pendulum(), {}), grids, {"swing": START}, [("swing", name) for name in FREE])


def alike(at: Normal, recording: Indices, prior: Array, ratios: Array) -> Certainty:
    """Certainty as of independent windows of recordings that are alike."""
    found = covariance(ratios.T @ at.information @ ratios, at.scores @ ratios, ratios.T @ prior @ ratios)
    return Certainty(ratios @ found @ ratios.T, np.zeros(len(prior)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_an_offset_that_varies_has_an_interval_that_holds_the_mean(seed: int) -> None:
    found, k = fitted(repeats(SPREAD, seed)), FREE.index("torque_offset")
    assert [name for name, x in zip(FREE, found.spread, strict=True) if x > 0] == ["torque_offset"]
    assert SPREAD / 3 < found.spread[k] < 3 * SPREAD and found.std[k] > found.spread[k] / 2
    assert abs(found.values[k] - SWING.torque_offset) < 1.96 * found.std[k]


def test_repeats_without_variation_have_the_intervals_of_before() -> None:
    grids = repeats(0.0, 3)
    found = fitted(grids)
    with mock.patch("signid.servo.fit.fit.certainty", alike):
        before = fitted(grids)
    assert not found.spread.any()
    assert_allclose(found.std, before.std, rtol=0.1)


def test_windows_that_are_not_independent_have_wider_intervals() -> None:
    rng, each = np.random.default_rng(0), np.ones((60, 1, 1))
    white = rng.standard_normal((60, 1))
    slow = np.repeat(rng.standard_normal((6, 1)), 10, axis=0)
    one, none = np.zeros(60, int), np.zeros((1, 1))
    for scores, wider in ((white, 1.05), (slow, 1.5)):
        at = Normal(each, scores - scores.mean(0), each, each, each)
        std, before = (
            np.sqrt(x[0, 0]) for x in (certainty(at, one, none, np.eye(1))[0], covariance(each.sum(0), at.scores))
        )
        assert (std > wider * before) == (wider > 1.1) and std >= before
    assert std > np.std(slow[::10], ddof=1) / np.sqrt(6)


def test_identify_names_it_in_the_document_and_a_note() -> None:
    robot = pendulum()
    recordings = [
        read_recording({"t": np.arange(len(one)) / one.rate, "q": one.q, "q_des": one.command}, robot)
        for one in repeats(3 * SPREAD, 4)
    ]
    found = identify_servos(robot, recordings, laws="effort", options=ServoOptions(additional=()))
    (named,) = servo_identification_document(found)["varies"]
    assert (named["effect"], named["joint"], named["parameter"]) == ("torque_offset", "swing", "offset")
    assert named["unit"] == "N.m" and SPREAD < named["spread"] < 9 * SPREAD
    assert any("torque offset of swing (" in note for note in found.notes)
