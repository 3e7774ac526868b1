"""The smallest law that would have been named: in closed form against simulation, and in recordings of an arm."""

from __future__ import annotations

import numpy as np
import pytest
from random_rows import DISPERSION, OFFSET, SPRING, VISCOUS, WAVE, rows, table

from signid.diagnose.data.rows import Group
from signid.diagnose.detectable import NAMING_PROBABILITY, measure_power
from signid.diagnose.evidence.bayes_factors import Evidence, log_bayes_factor


def of_group(evidence: Evidence, group: Group, squares: list[np.ndarray]) -> np.ndarray:
    """The (1, d, d) of one hypothesis among those of all batches."""
    (found,) = (
        square[[g]]
        for batch, square in zip(evidence.batches, squares, strict=True)
        for g, k in enumerate(batch.groups)
        if evidence.data.groups[k] is group
    )
    return found


@pytest.mark.parametrize(("group", "within"), [(VISCOUS, 0.02), (OFFSET, 0.02), (SPRING, 0.05), (WAVE, 0.05)])
def test_the_log_bayes_factor_is_exceeded_with_the_probability_that_is_named(group: Group, within: float) -> None:
    rng, evidence = np.random.default_rng(3), rows()
    own = of_group(evidence, group, evidence.complements((), DISPERSION, 1.0))
    (batch,) = (b for b in evidence.batches if group in [evidence.data.groups[k] for k in b.groups])
    which = np.array([[evidence.data.groups[k] for k in batch.groups].index(group)])
    direction, priors = np.eye(group.size)[:1], batch.priors.take(which)
    power = measure_power(priors, own[None], own, direction, np.zeros(1))
    noise = rng.standard_normal((4000, group.size)) @ np.linalg.cholesky(own[0]).T
    for at in (12, 20):  # 5 and 20 standard deviations
        z = power.sizes[at] * (own[0] @ direction[0]) + noise
        found = log_bayes_factor(priors, own, z[:, None, :])[:, 0]
        assert np.mean(found >= power.log[at, 0]) == pytest.approx(NAMING_PROBABILITY, abs=within)


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_evidence_of_the_others_grows_as_much_as_they_can_explain(scale: float) -> None:
    data, size, direction = rows().data, 0.4, np.array([1.0, 0.0])
    own = of_group(rows(), SPRING, rows().complements((VISCOUS,), DISPERSION, scale))[0]
    torque = np.array([data.part(j, SPRING) @ direction * size for j in range(data.joints)])
    with_law, without = (
        Evidence(table(data.columns, y, data.recording)).fit((VISCOUS,), DISPERSION, scale).log_evidence
        for y in (torque, 0 * torque)
    )
    most = np.sum(np.sum(torque**2, axis=1) / DISPERSION)
    assert with_law - without == pytest.approx((most - size**2 * own[0, 0]) / 2)


def test_a_larger_scale_of_inertials_makes_laws_that_they_imitate_harder_to_name() -> None:
    evidence = rows()
    exact, free = (of_group(evidence, SPRING, evidence.complements((), DISPERSION, k))[0, 0, 0] for k in (0.0, 2.0))
    assert free < exact


def test_a_healthy_arm_lists_sizes_and_three_times_the_size_is_named() -> None:
    pytest.importorskip("mujoco")
    from diagnosed import fault, look, named

    healthy = look("3r")
    sizes = {(one.effect, one.joint): one for one in healthy.detectable}
    friction = sizes["viscous_friction", "joint_2"]
    assert (friction.parameter, friction.unit) == ("coefficient", "N.m.s/rad") and friction.smallest is not None
    assert sizes["payload", "joint_3"].unit == "kg" and sizes["base_tilt", None].parameter == "x"
    assert sizes["link_inertia", "joint_1"].smallest is None, "its mass at the vertical axis makes no torque"
    assert named(look("3r", fault("viscous_friction", 2, coefficient=3 * friction.smallest))) == [
        ("viscous_friction", (1,))
    ]
