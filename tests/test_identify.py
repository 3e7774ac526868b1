"""From recordings to a model: held out, consistent, the same every time."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from motions import trial, truth
from numpy.testing import assert_allclose

import signid
from signid.errors import OptionError, RecordingError
from signid.identify import Identification
from signid.model import stated_parameters
from signid.regression.motion import Motion
from signid.regression.session import Options
from signid.types import Array, Robot


@pytest.fixture(scope="module")
def arm() -> Robot:
    return signid.load_robot("3r")


@pytest.fixture(scope="module")
def found(arm: Robot) -> Identification:
    return signid.identify(arm, [trial(arm).noisy()])


def test_the_standard_parameters_reproduce_the_base_parameters(found: Identification) -> None:
    assert_allclose(found.base.combination @ found.parameters.values, found.base_value, rtol=1e-12)
    assert found.physically_consistent
    assert found.parameters.is_feasible()


def test_the_estimate_is_the_truth_within_its_intervals(found: Identification, arm: Robot) -> None:
    right = found.base.combination @ truth(arm)
    assert np.mean(np.abs(found.base_value - right) < 3 * found.estimate.std + 0.01) == 1


def test_the_fit_is_evaluated_on_held_out_rows(found: Identification) -> None:
    assert (found.fit.held_out_r2 > 0.999).all()
    assert_allclose(found.fit.held_out_rms, found.fit.train_rms, rtol=0.5)
    assert (found.fit.noise_floor < found.fit.held_out_rms).all()
    assert found.flags == ()


def test_the_last_of_several_recordings_is_held_out(arm: Robot) -> None:
    recordings = [trial(arm, seed=s, seconds=12).recording() for s in (1, 2)]
    automatic = signid.identify(arm, recordings, refit=False)
    by_hand = signid.identify(arm, recordings[:1], held_out=recordings[1:])
    assert_allclose(automatic.base_value, by_hand.base_value)
    assert_allclose(automatic.fit.held_out_rms, by_hand.fit.held_out_rms)


def test_the_same_inputs_give_the_same_numbers(arm: Robot) -> None:
    recording = trial(arm, seconds=12).recording()
    first, second = (signid.identify(arm, [recording]) for _ in range(2))
    assert np.array_equal(first.base_value, second.base_value)
    assert np.array_equal(first.estimate.covariance, second.estimate.covariance)


def test_unknown_options_are_refused(arm: Robot) -> None:
    made = trial(arm, seconds=5)
    with pytest.raises(OptionError, match="signs 'magic' is none of exact, tree"):
        signid.identify(arm, [made.recording()], signs="magic")
    with pytest.raises(OptionError, match="method 'magic' is none of"):
        signid.identify(arm, [made.recording()], method="magic")
    with pytest.raises(OptionError, match="no effect named 'stiction'"):
        signid.identify(arm, [made.recording()], options=signid.Options(effects=("stiction",)))
    with pytest.raises(RecordingError, match="different rates"):
        signid.identify(arm, [made.recording(), trial(arm, rate=100.0, seconds=5).recording()])


def swinging(arm: Robot, size: float, frequency: float, stop: float = np.inf) -> dict[str, Array]:
    """Joints that swing one at a time and stand still from some time [s] on."""
    t, rng = np.arange(0, 20, 0.005), np.random.default_rng(0)
    rate = 2 * np.pi * frequency * np.array([1.0, 1.13, 1.29])
    phase = np.outer(np.minimum(t, stop), rate) + np.arange(3)
    moves = (t < stop)[:, None]
    q, v, a = size * np.sin(phase), size * rate * np.cos(phase) * moves, -size * rate**2 * np.sin(phase) * moves
    torque = Motion(arm, t, q, v, a).load + 0.3 * v + 0.5 * np.sign(v)
    return {"t": t, "q": q + 1e-6 * rng.standard_normal(q.shape) * moves, "tau": torque}


def test_rows_all_near_reversals_are_reported(arm: Robot) -> None:
    recording = signid.read_recording(swinging(arm, 0.01, 6.0), arm)
    found = signid.identify(arm, [recording], options=Options(cutoff=3.0))
    assert any("joint_1, joint_2, joint_3 lie near reversals" in flag for flag in found.flags)
    assert any("25 of 25 base parameters are not identifiable" in flag for flag in found.flags)
    stated = found.base.combination @ stated_parameters(found.session.task).values
    assert_allclose(found.estimate.value, stated), "unidentifiable parameters keep the values of the description"


def test_held_out_rows_at_rest_do_not_evaluate_the_fit(arm: Robot) -> None:
    found = signid.identify(arm, [signid.read_recording(swinging(arm, 0.6, 0.35, stop=12.0), arm)])
    assert np.isnan(found.fit.held_out_r2).all() and np.isfinite(found.fit.held_out_rms).all()
    assert sum("is constant, so it has no R2" in note for note in found.notes) == 3


def test_check_reports_before_the_fit(arm: Robot) -> None:
    good = signid.check(arm, [trial(arm).recording()])
    poor = signid.check(arm, [trial(arm, rest=(2,)).recording()])
    assert good.flags == ()
    assert poor.flags
    assert poor.verdicts.count("unidentifiable") > good.verdicts.count("unidentifiable")
    assert (good.used > 0.5).all()


def test_unneeded_modules_are_not_imported(tmp_path: Path) -> None:
    recording = Path(__file__).parents[1] / "robots" / "3r" / "recording.parquet"
    command = ["identify", "3r", str(recording), "-o", str(tmp_path / "result")]
    heavy = {"scipy", "cvxpy", "mujoco", "signid.simulation.rollout", "signid.simulation.plant"}
    code = f"import sys; from signid.cli import run; run({command}); sys.exit(str(sorted({heavy} & set(sys.modules))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=False)
    assert done.stderr.splitlines()[-1] == "[]"


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_joints_at_rest_and_joints_in_step_are_named(arm: Robot) -> None:
    made = trial(arm)
    still, step = made.q * [1.0, 0.0, 1.0], made.q * [1.0, 1.0, 0.0] + 0.7 * made.q[:, [1]] * [0.0, 0.0, 1.0]
    resting, coupled = (signid.identify(arm, [made.recording(q=q)]).excitation for q in (still, step))
    assert (resting.resting, resting.in_step, resting.sufficient) == (("joint_2",), (), False)
    assert any("joint joint_2 did not move" in sentence for sentence in resting.sentences)
    assert coupled.in_step == (("joint_2", "joint_3"),)
