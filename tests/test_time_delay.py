"""Torque that is recorded late, and torque that leads the motion: one law with a sign."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arm import smooth_motion
from numpy.testing import assert_allclose

import signid
from signid.cli import run
from signid.effects import EFFECTS
from signid.effects.base import Trial
from signid.effects.naming import parse_law
from signid.identify import Identification
from signid.types import Array

DELAY: Any = EFFECTS["time_delay"]
ALL = (0, 1, 2)
ENOUGH = 1e-3  # [s] that a delay may be off by


def shifted(torque: Array, delay: float, dt: float = 1e-3) -> Array:
    x = Trial(torque, torque, t=dt * np.arange(len(torque))[:, None], dt=dt, torque=torque, joints=(0,))
    return np.asarray(DELAY.recorded_torque(x, delay=delay))


@pytest.mark.parametrize("delay", (0.008, -0.008, 0.00413, -0.00413, 0.0))
def test_the_record_is_shifted_in_either_direction_up_to_its_ends(delay: float) -> None:
    t = 1e-3 * np.arange(1000)
    torque, wanted = (np.sin(2 * np.pi * 3 * moment)[:, None] for moment in (t, t - delay))
    assert_allclose(shifted(torque, delay)[20:-20], wanted[20:-20], atol=1e-5)
    assert_allclose(shifted(torque, delay), wanted, atol=0.005)  # held at the ends it would be off by 0.15
    x = Trial(torque, torque, t=t[:, None], dt=1e-3, torque=shifted(torque, delay), joints=(0,))
    assert_allclose(DELAY.acted_torque(x, delay=delay)[20:-20], torque[20:-20], atol=1e-5)


def test_a_delay_longer_than_the_record_is_no_fault() -> None:
    torque = np.arange(5.0)[:, None]
    for delay in (1.0, -1.0):
        assert np.isfinite(shifted(torque, delay)).all()


def test_columns_are_odd_in_the_delay() -> None:
    x = smooth_motion().at(ALL)
    one, other = (DELAY.change(x, {"delay": d}) for d in (1e-4, -1e-4))
    assert_allclose(one, -other, atol=1e-3 * np.abs(one).max())


def test_words_say_which_comes_first() -> None:
    assert DELAY.meaning({"delay": -0.008}) == "torque leads the motion by 8.0 ms"
    assert DELAY.meaning({"delay": 0.00804}) == "torque recorded 8.0 ms late"
    assert {effect.name for effect in EFFECTS if effect.meaning(effect.example)} == {"time_delay"}


def test_torque_that_leads_is_injected_by_the_command_line(tmp_path: Path) -> None:
    """The same robot, its torque 8 ms earlier in the file."""
    assert parse_law("time_delay:delay=-0.008", signid.load_robot("3r")).parameters == {"delay": -0.008}
    for name, inject in {"plain": [], "early": ["--inject", "time_delay:delay=-0.008"]}.items():
        command = ["simulate", "3r", "--duration", "2", "--rate", "1000", "-o", str(tmp_path / f"{name}.csv"), *inject]
        assert run(command) == 0
    robot = signid.load_robot("3r")
    plain, early = (signid.read_recording(tmp_path / f"{name}.csv", robot).read() for name in ("plain", "early"))
    assert_allclose(early.q, plain.q, atol=1e-9)
    assert_allclose(early.tau[:-8], plain.tau[8:], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("delay", (0.008, -0.008))
def test_the_diagnosis_of_a_robot_in_mujoco_finds_the_direction(delay: float) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")
    from diagnosed import fault, look, named

    from signid.output.report.results.diagnosis import diagnosis_document
    from signid.output.report.results.sentences import finding_words

    found = look("3r", fault("time_delay", delay=delay))
    assert named(found) == [("time_delay", ALL)] and len(found.findings) == 1
    (finding,) = found.findings
    assert finding.law.parameters["delay"] == pytest.approx(delay, abs=ENOUGH)
    words = f"torque {'recorded 8' if delay > 0 else 'leads the motion by '}"
    assert finding_words(found.robot, finding).numbers[-1].startswith(words)
    assert diagnosis_document(found)["findings"][0]["meaning"].startswith(words)
    assert np.all(found.after.held_out_rms < 1.6 * found.after.irreducible_rms)
    if delay < 0:  # no amplifier answers before it is asked
        assert finding.probability > 0.99 and "torque_lag" not in {a.law.effect.name for a in finding.alternatives}


def identified(delay: float) -> Identification:
    from diagnosed import fault, read, recorded

    planted = [fault("time_delay", delay=delay)] if delay else []
    return signid.identify(signid.load_robot("3r"), read("3r", recorded("3r", *planted)))


@pytest.mark.slow_cases("^0")
@pytest.mark.parametrize(("delay", "words"), ((0.008, "ms late"), (-0.008, "ms early")))
def test_identify_flags_a_delay_and_names_the_next_command(delay: float, words: str) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")
    (flag,) = identified(delay).flags
    assert words in flag and "signid diagnose" in flag
    said = float(flag.removeprefix("the torque is recorded ").split()[0])
    assert said == pytest.approx(8, abs=1)  # [ms]
    assert identified(0.0).flags == ()
