"""Intervals of one real robot: parameters from different recordings agree within them, those of noise alone do not."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import signid
from benchmarks.real_data import ur10e
from signid.estimation.least_squares import estimate
from signid.identify import Identification
from signid.types import TWO_SIDED, Array

TARGET = 93.0  # lower bound on the share of differences within their intervals [%]
FRICTION = ("viscous_friction", "coulomb_friction")
UR10E = ("20_01_31_unload", "20_02_10_30sec_12harm", "20_02_12_40sec_12harm", "20_02_12_50sec_12harm")
SETS = {  # folder, description, recordings
    "UR10e": ("ur10e_mamedov", "", tuple(f"identification_data__{name}" for name in (*UR10E, "20_02_19_14harm50sec"))),
    "PSM": ("dvrk_wpi", "psm3.urdf", ("psm3_one", "psm3_two", "psm3_one_no_weight")),
    "EMPS": ("emps_janot", "emps.urdf", ("emps_train", "emps_pulses")),
    "LWR4+": ("kuka_lwr4_flobaroid", "kuka_lwr4.urdf", ("measurements_1", "measurements_2", "measurements_3")),
}


def share(values: Sequence[Array], stds: Sequence[Array], which: Array) -> float:
    """Share of differences between two recordings within 1.96 joint standard deviations [%].

    Args:
        values: estimates of each recording (b,) [units of base].
        stds: standard deviations of each recording (b,) [units of base]; infinite ones do not count.
        which: mask of parameters (b,).
    """
    pairs = list(itertools.combinations(range(len(values)), 2))
    z = [np.abs(values[i] - values[k])[which] / np.hypot(stds[i], stds[k])[which] for i, k in pairs]
    known = [np.isfinite(np.hypot(stds[i], stds[k]))[which] for i, k in pairs]
    return float(100 * np.mean(np.concatenate(z)[np.concatenate(known)] <= TWO_SIDED))


def noise_alone(found: Identification) -> Array:
    """Standard deviations (b,) [units of base] without discrepancy, delay and drift of friction."""
    return estimate(replace(found.session.reduce(found.session.train), sample=None), found.base).std


def test_the_share_counts_differences_within_joint_intervals() -> None:
    values, stds = [np.zeros(3), np.array([1.0, 3.0, 9.0])], [np.array([1.0, 1.0, np.inf])] * 2
    assert share(values, stds, np.ones(3, bool)) == 50.0
    assert share(values, stds, np.array([True, False, False])) == 100.0


@pytest.mark.slow_cases(but="EMPS")
@pytest.mark.parametrize("name", SETS)
def test_recordings_of_a_real_robot_agree(name: str, data: Path) -> None:
    folder, description, recordings = SETS[name]
    robot = signid.load_robot(data / folder / description) if description else ur10e()
    files = [signid.read_recording(data / folder / f"{file}.csv.gz", robot) for file in recordings]
    found = [signid.identify(robot, [file]) for file in files]
    assert len({tuple(one.base.expressions) for one in found}) == 1
    leads = [found[0].base.labels[int(k)].name for k in found[0].base.independent]
    friction = np.array([lead.startswith(FRICTION) for lead in leads])
    values, consistent, full = (
        [one.estimate.value for one in found],
        [one.base_value for one in found],
        [one.estimate.std for one in found],
    )
    for which in (friction | True, friction):
        assert share(values, full, which) >= TARGET and share(consistent, full, which) >= TARGET
    noise = [noise_alone(one) for one in found]
    assert min(share(values, noise, which) for which in (friction | True, friction)) < TARGET
