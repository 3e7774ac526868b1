"""Estimators compared with least squares: equal without noise, unbiased where positions are noisy."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from motions import trial

import signid
from benchmarks.arms import ARMS, load, truth
from benchmarks.plants.mujoco_ import Body, Motion, Track, draw_motion, log, simulate
from signid.cli import run
from signid.errors import OptionError
from signid.estimation.estimators import ESTIMATORS, Estimator
from signid.estimation.estimators.oe import OutputErrorEstimator
from signid.identify import Identification
from signid.regression.session import Options
from signid.types import Array, Robot

ARM = ARMS[0]
WIDE, NOISE, MUCH = 8.0, 5e-4, 1e-3  # Hz, rad: least squares is biased
SEEDS = (0, 1)
ROOT = Path(__file__).parents[1]


@cache
def arm() -> Robot:
    return load(ARM)


@cache
def recorded(seed: int) -> tuple[Track, Motion]:
    motion = draw_motion(ARM.centre, seed)
    return simulate(Body(arm().document, arm().joints), ARM.drives, motion, 16.0, ARM.rate), motion


def columns(seed: int, noise: float, torque: float = 0.02, desired: bool = True) -> dict[str, Array]:
    track, motion = recorded(seed)
    made, rng = log(track, 100 + seed, 26, torque), np.random.default_rng([seed, 3])
    for j in range(3):
        made[f"q_{j + 1}"] = made[f"q_{j + 1}"] + noise * rng.standard_normal(len(track.t))
        if desired:
            made[f"q_des_{j + 1}"] = motion.at(track.t)[0][:, j]
    return made


@cache
def identified(how: str | Estimator | None, seed: int, noise: float, torque: float, cutoff: float) -> Identification:
    made = signid.read_recording(columns(seed, noise, torque), arm())
    other = signid.read_recording(columns(9, 0.0), arm())
    options = Options(cutoff=cutoff)
    return signid.identify(arm(), [made], held_out=[other], method="wls", estimator=how, options=options)


def off(found: Identification) -> float:
    """Distance of the estimate from the truth, over the truth."""
    right = truth(ARM, found.session)
    return float(np.linalg.norm(found.estimate.value - right) / np.linalg.norm(right))


@pytest.mark.slow_cases("^oe")
@pytest.mark.parametrize("how", ["iv", "tls", "oe"])
def test_without_noise_all_agree_with_least_squares(how: str) -> None:
    plain, other = (identified(name, 0, 0.0, 0.0, WIDE) for name in ("wls", how))
    scale = np.linalg.norm(plain.estimate.value)
    limit = {"iv": 1e-4, "tls": 1e-6, "oe": 2e-3}[how]  # a simulation takes steps, and friction jumps between them
    assert np.linalg.norm(other.estimate.value - plain.estimate.value) < limit * scale
    assert other.estimate.method == ESTIMATORS[how].title
    assert not other.flags


@pytest.mark.slow
def test_bias_of_least_squares_is_removed() -> None:
    ways = ("wls", "iv", "tls", "oe")
    means = {how: np.mean([off(identified(how, seed, NOISE, 0.01, WIDE)) for seed in SEEDS]) for how in ways}
    assert means["iv"] < 0.5 * means["wls"]
    assert means["oe"] < 0.5 * means["wls"]
    assert means["tls"] < 0.8 * means["wls"]


@pytest.mark.slow
def test_intervals_cover_the_truth_better_than_inflated_least_squares() -> None:
    def away(how: str) -> float:
        found = [identified(how, seed, MUCH, 0.02, WIDE) for seed in SEEDS]
        z = [(f.estimate.value - truth(ARM, f.session)) / f.estimate.std for f in found]
        return float(np.sqrt(np.mean(np.square(z))))

    assert away("iv") < 1.2 and away("iv") < away("wls") < 1.7


def test_the_default_is_unchanged() -> None:
    session = identified(None, 0, NOISE, 0.02, WIDE)
    assert session.estimate.method == "instrumental variables"
    assert any("desired positions served as instruments" in note for note in session.notes)
    made = signid.read_recording(columns(0, NOISE, desired=False), arm())
    default, asked = (
        signid.identify(arm(), [made], method="wls", estimator=how, options=Options(cutoff=WIDE))
        for how in (None, "wls")
    )
    assert np.array_equal(default.estimate.value, asked.estimate.value)
    assert np.array_equal(default.estimate.covariance, asked.estimate.covariance)


@pytest.mark.slow
def test_stated_gains_take_the_place_of_those_found() -> None:
    from benchmarks.plants.control import gains
    from benchmarks.plants.mujoco_ import build, mean_inertia

    body, (track, motion) = Body(arm().document, arm().joints), recorded(0)
    known = build(body, ARM.drives, frictionless=True, weigh=False)
    asked = motion.at(np.arange(0, track.t[-1], 2.5e-4))[0]
    stated = gains(mean_inertia(known, arm().joints, asked[:: len(asked) // 20]))
    found = identified(OutputErrorEstimator(gains=stated), 0, NOISE, 0.02, WIDE)
    assert any("gains of the controller are as stated" in note for note in found.notes)
    assert off(found) < 0.05


@pytest.mark.slow
def test_every_estimator_downweights_outliers() -> None:
    made = columns(0, 0.0)
    rng = np.random.default_rng(4)
    for start in rng.integers(0, len(made["t"]) - 40, 6):
        made[f"tau_{rng.integers(3) + 1}"][start : start + 40] += 20
    recording = signid.read_recording(made, arm())
    for how in ("tls", "oe"):
        plain, robust = (
            off(signid.identify(arm(), [recording], method="wls", estimator=how, options=Options(robust=robust)))
            for robust in (False, True)
        )
        assert robust < 0.6 * plain, how


def test_impossible_options_are_refused() -> None:
    blind = signid.read_recording(columns(0, NOISE, desired=False), arm())
    for how in ("iv", "oe"):
        with pytest.raises(OptionError, match=rf"estimator {how} .* q_des_J of every joint; joint_1 has none"):
            signid.identify(arm(), [blind], estimator=how)
        with pytest.raises(OptionError, match="cannot use recorded derivatives; choose computed ones"):
            signid.identify(arm(), [blind], estimator=how, options=Options(derivatives="recorded"))
    with pytest.raises(OptionError, match="there is no estimator named 'tl'; did you mean tls"):
        signid.identify(arm(), [blind], estimator="tl")


def test_noise_beyond_total_least_squares_is_flagged() -> None:
    found = identified("tls", 0, 2e-3, 0.02, 12.0)
    assert any("position noise is" in flag and "lower the cut-off" in flag for flag in found.flags)


@pytest.mark.slow
def test_a_joint_at_rest_stays_unidentified() -> None:
    made = trial(signid.load_robot("3r"), rest=(2,), seconds=8)
    for how in ("tls", "iv", "oe"):
        found = signid.identify(made.robot, [made.recording(q_des=made.q)], estimator=how)
        assert np.isinf(found.estimate.std).any() and found.flags, how


def test_another_package_can_register_an_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.metadata

    point = importlib.metadata.EntryPoint("mine", "signid.estimation.estimators.wls:PLUGIN", "signid.estimators")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [point])
    assert ESTIMATORS["mine"].title == "weighted least squares"


@pytest.mark.slow_cases("^oe")
@pytest.mark.parametrize("how", ["wls", "tls", "oe"])
def test_the_command_names_the_estimator(how: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "recording.parquet"
    pl.DataFrame(columns(0, 1e-4)).write_parquet(path)
    assert run(["identify", str(ROOT / "robots" / "3r"), str(path), "--estimator", how, "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["estimator"] == ESTIMATORS[how].title


def test_the_command_refuses_in_one_sentence(capfd: pytest.CaptureFixture[str]) -> None:
    arm, recording = ROOT / "robots" / "3r", ROOT / "robots" / "3r" / "recording.parquet"
    for how in ("oe", "least"):
        assert run(["identify", str(arm), str(recording), "--estimator", how, "--json"]) == 2
        out, err = capfd.readouterr()
        assert not out and err.startswith("signid: ") and err.count("\n") == 1
