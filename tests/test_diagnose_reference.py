"""Differences also present in a healthy reference are no findings, on small evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis_rows import NOISE, Question, law, moved, names, pose

import signid
from signid.diagnose import run
from signid.diagnose.search.iterate import _Conditions, _expected, _search
from signid.diagnose.thresholds import MODEL_ERROR, NOISE_ERROR
from signid.effects.law import law_torque
from signid.model import Model, stated_inertials
from signid.types import Law, Recording

LIBRARY = (law("viscous_friction"), law("spring"))
SPRING, VISCOUS = law("spring", stiffness=1.5, rest=0.2), law("viscous_friction", coefficient=0.3)


def reference(train_rms: float) -> Any:
    """A diagnosis with this rms residual [N.m] of the extended simulation, above the noise."""
    after = SimpleNamespace(train_rms=np.array([train_rms]), irreducible_rms=np.array([NOISE]))
    return SimpleNamespace(after=after)


def selected(one: Question, healthy: Any) -> set[str]:
    return names(_search(one.dataset, one.posterior, _Conditions(("external_contact",), healthy)))


def test_the_residual_of_the_reference_counts_as_noise() -> None:
    one = pose(LIBRARY)
    data = one.posterior.evidence.data
    bare = _expected(one.posterior, None)
    np.testing.assert_allclose(bare, NOISE_ERROR * (1 + (MODEL_ERROR * data.scale / data.floor) ** 2))
    np.testing.assert_allclose(_expected(one.posterior, reference(20 * NOISE)), [400.0])
    np.testing.assert_array_equal(_expected(one.posterior, reference(NOISE)), bare)


@pytest.mark.parametrize(("rms", "found"), [(NOISE, {"spring"}), (1000.0, set())])
def test_a_law_within_the_residual_of_the_reference_is_no_finding(rms: float, found: set[str]) -> None:
    assert selected(pose(LIBRARY, SPRING), reference(rms)) == found


def recording(seed: int, *planted: Law) -> Recording:
    """A recording of a robot with these laws."""
    motion = moved("1r", seed)
    torque = motion.load + NOISE * np.random.default_rng(seed).standard_normal(motion.q.shape)
    for one in planted:
        torque += law_torque(one, motion)[1]
    columns = {"t": motion.t, "q_1": motion.q[:, 0], "tau_1": torque[:, 0]}
    return signid.read_recording(columns, motion.robot)


def test_differences_present_in_the_reference_are_no_findings() -> None:
    """Viscous friction is in both, the spring in the second alone."""
    robot = signid.load_robot("1r")
    model = Model(robot, stated_inertials(robot), ())
    healthy, faulty = recording(1, VISCOUS), recording(2, VISCOUS, law("spring", stiffness=6.0, rest=0.2))
    skip = tuple(name for name in signid.effects.EFFECT_NAMES if name not in ("viscous_friction", "spring"))
    new = signid.diagnose(model, [faulty], reference=[healthy], skip=skip)
    assert {one.law.effect.name for one in new.findings} == {"spring"}
    assert {one.effect.name for one in new.model.laws} == {"viscous_friction", "spring"}
    assert [one.path for one in new.inputs if one.sha256 == healthy.sha256]


def test_events_of_the_reference_are_not_expected_again() -> None:
    contact = law("external_contact", start=1.0, end=2.0, force_x=1.0, force_y=0.0, force_z=0.0)
    robot = signid.load_robot("1r")
    model = Model(robot, stated_inertials(robot), (VISCOUS, contact))
    assert run._lasting(model).laws == (VISCOUS,)
    assert run._lasting(replace(model, laws=(VISCOUS,))).laws == (VISCOUS,)
