"""Extended simulations: findings added, useless laws pruned, twins listed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from diagnosed import DRIVES, fault, look, named, posed, simulation
from plant import law

from signid.diagnose.data.dataset import Fitted, solve
from signid.diagnose.data.hypotheses import Hypothesis, is_refitted, propose
from signid.diagnose.data.rows import Group, tolerance
from signid.diagnose.extend import extend
from signid.diagnose.findings.findings import tell_apart
from signid.diagnose.search.contributions import measure_contributions, residual_growth
from signid.diagnose.search.stepwise import inertial_violations, prune
from signid.diagnose.thresholds import PLAUSIBLE_PROBABILITY
from signid.effects import EFFECTS
from signid.model import Model, stated_inertials
from signid.regression.base_parameters import build_base
from signid.robot import load_robot
from signid.types import Array, Law, pseudo_inertia

ARM = load_robot("3r")
BODIES = 30  # numbers of its inertials
FLOOR = np.full(3, 0.01)
NEVER = "no motion can distinguish them; another sensor or a known load is needed"


def simulated(*laws: Law) -> Model:
    return Model(ARM, stated_inertials(ARM), laws)


def refitted(model: Model, steps: dict[int, float], bodies: Array | None = None) -> tuple[list[Group], Fitted]:
    """Groups in column order, and a fit with the given error of each law's first coefficient."""
    groups, at, value = list[Group](), 0, list[float]()
    for k, one in enumerate(x for x in model.laws if is_refitted(x)):
        size = len(one.effect.coefficients(one.parameters))
        groups.append(Group(at, size, law=one, deviation=(np.inf,) * size))
        value += [steps.get(k, 0.0), *[0.0] * (size - 1)]
        at += size
    groups.append(Group(at, BODIES, bodies=True, deviation=(1.0,) * BODIES))
    value += [0.0] * BODIES if bodies is None else bodies.tolist()
    which = np.arange(len(value) if bodies is not None else at)
    values = np.array(value)[: len(which)]
    return groups, solve(which, 1e12 * np.eye(len(which)), 1e12 * values, 1e-12 * np.eye(len(which)))


def added(*laws: Law) -> dict[Group, tuple[Law, ...]]:
    return {Group(k, 0, Hypothesis((one,))): (one,) for k, one in enumerate(laws)}


def numbers(model: Model, effect: str, *joints: int) -> dict[str, float]:
    (one,) = [x for x in model.laws if (x.effect.name, x.joints) == (effect, joints)]
    return dict(one.parameters)


def test_a_stated_law_becomes_the_sum() -> None:
    model = simulated(law("viscous_friction", 0, coefficient=0.5), law("armature", 1, inertia=0.2))
    groups, fit = refitted(model, {0: 0.1})
    wider = extend(model, groups, fit, added(law("armature", 1, inertia=0.05), law("armature", 2, inertia=0.01)))
    assert len(wider.laws) == 3
    assert numbers(wider, "viscous_friction", 0)["coefficient"] == pytest.approx(0.6)  # refitted
    assert numbers(wider, "armature", 1)["inertia"] == pytest.approx(0.25)  # stated, plus the missing part
    assert numbers(wider, "armature", 2)["inertia"] == 0.01
    assert numbers(model, "armature", 1) == {"inertia": 0.2}  # the simulation as given stays


def test_friction_is_never_negative() -> None:
    model = simulated(law("coulomb_friction", 0, level=0.5), law("torque_offset", 1, offset=0.2))
    groups, fit = refitted(model, {0: -0.7, 1: -0.5})
    wider = extend(model, groups, fit, {})
    assert numbers(wider, "coulomb_friction", 0) == {"level": 0}
    assert numbers(wider, "torque_offset", 1)["offset"] == pytest.approx(-0.3)


def test_contained_laws_are_merged() -> None:
    plain = (
        law("viscous_friction", 0, coefficient=0.5),
        law("coulomb_friction", 0, level=0.3),
        law("torque_offset", 0, offset=0.1),
    )
    other = law("coulomb_friction", 1, level=0.7)
    model = simulated(*plain, other)
    more = law("asymmetric_friction", 0, viscous_positive=0.2, viscous_negative=0.1, coulomb_positive=0.05,
               coulomb_negative=-0.05)  # fmt: skip
    wider = extend(model, *refitted(model, {}), added(more))
    assert [(x.effect.name, x.joints) for x in wider.laws] == [
        ("coulomb_friction", (1,)),
        ("asymmetric_friction", (0,)),
    ]
    expected = {"viscous_positive": 0.7, "viscous_negative": 0.6, "coulomb_positive": 0.45, "coulomb_negative": 0.15}
    assert numbers(wider, "asymmetric_friction", 0) == pytest.approx(expected)


def test_two_laws_with_shapes_stay_separate() -> None:
    one, other = (law("stribeck_friction", 0, level=0.3, velocity=v) for v in (0.1, 0.2))
    model = simulated(one)
    wider = extend(model, *refitted(model, {}), added(other))
    assert [x.parameters["velocity"] for x in wider.laws] == [0.1, 0.2]


@pytest.mark.parametrize("size", (0.1, 1.0, 30.0))
def test_bodies_stay_physically_consistent(size: float) -> None:
    model = simulated()
    step = size * tolerance(model).ravel() * np.random.default_rng(3).standard_normal(BODIES)
    wider = extend(model, *refitted(model, {}, step), {})
    for body in wider.inertials:
        assert np.linalg.eigvalsh(pseudo_inertia(body)).min() > 0


def test_bodies_equivalent_to_consistent_ones_become_consistent() -> None:
    model, base = simulated(), build_base(ARM)
    real = model.inertials * np.array([1.0, 1.1, 0.9])[:, None]
    step = (real - model.inertials).ravel()
    hidden = np.linalg.svd(base.combination)[2][base.rank :]
    beside = 10 * hidden.T @ (hidden @ np.random.default_rng(4).standard_normal(BODIES))  # no torque shows it
    moved = (step + beside + model.inertials.ravel()).reshape(-1, 10)
    assert min(np.linalg.eigvalsh(pseudo_inertia(body)).min() for body in moved) < 0
    for change, share in ((step, 1e-9), (step + beside, 0.02)):
        wider = extend(model, *refitted(model, {}, change), {})
        off = base.combination @ (wider.inertials - real).ravel()
        assert np.linalg.norm(off) < share * np.linalg.norm(base.combination @ step)
        assert all(np.linalg.eigvalsh(pseudo_inertia(body)).min() > 0 for body in wider.inertials)


def test_bodies_without_tolerance_do_not_change() -> None:
    model = simulated(law("viscous_friction", 0, coefficient=0.5))
    wider = extend(model, *refitted(model, {0: 0.1}), {})
    np.testing.assert_array_equal(wider.inertials, model.inertials)


def test_tolerances_are_shares_of_the_bodies() -> None:
    spread, masses = tolerance(simulated()), np.array([10, 1.125, 0.75])
    np.testing.assert_allclose(spread[:, 0], 0.05 * masses)
    lever = np.array([[0, 0, 0.15], [0.15, 0, -0.15], [0.1, 0, 0]])
    np.testing.assert_allclose(spread[:, 1:4], masses[:, None] * np.hypot(0.05 * lever, 0.005))
    assert spread[2, 9] == pytest.approx(0.1 * (0.0026565 + 0.75 * 0.01)) and spread[2, 5] == spread[2, 9] / 2


SPRING = fault("spring", 2, stiffness=1.0, rest=0.2)


def test_the_size_of_a_stated_law_is_a_hypothesis() -> None:
    one = posed("3r")
    motion = one.dataset.pieces[0].motion
    whole = {h.key: h for h in propose(one.dataset.model, motion, ("spring",))}
    lacking = {h.key: h for h in propose(simulation("3r", ()), motion)}
    keys = set(whole)
    stated = whole["viscous_friction", (0,)].stated
    assert stated is not None and stated.parameters["coefficient"] == DRIVES["3r"].viscous_friction[0]
    assert lacking["viscous_friction", (0,)].stated is None
    assert not any(name.startswith("viscous_friction+") for name, _ in keys)
    assert ("armature", (0,)) in keys and not any(name == "spring" for name, _ in keys)
    assert ("time", (2,)) in keys


def test_a_law_that_makes_the_simulation_no_better_is_pruned() -> None:
    one = posed("3r", SPRING)
    spring, ripple = one.group("spring", 1), one.group("torque_ripple", 0)
    kept = prune(one.dataset, one.session, one.found(spring, ripple))
    assert kept.selected == (spring,)
    assert prune(one.dataset, one.session, one.found(ripple)).selected == ()
    assert prune(one.dataset, one.session, one.found()).selected == ()


def test_energy_is_the_reduction_of_the_squared_residual() -> None:
    one = posed("3r", SPRING)
    spring, offset = one.group("spring", 1), one.group("torque_offset", 0)
    contributions = measure_contributions(one.posterior.evidence, (spring, offset), one.found().dispersion, 0.0)
    gone = residual_growth(contributions)
    value, share = contributions.coefficients[spring], contributions.torque_share[spring]
    assert value[0] == pytest.approx(1.0, rel=0.05) and share[1] > 0.05
    assert gone[spring][1] > 1000 and gone[spring][0] < 1 and gone[offset].max() < 20
    assert np.all(contributions.mean_square < 1.6)


def test_a_link_beyond_any_tolerance_is_an_inertial_violation() -> None:
    assert inertial_violations(posed("3r").found()) == {}
    heavy = posed("3r", heavier=(("link_3", 1.5),))
    found = heavy.found()
    assert found.prior_scale > 0 and inertial_violations(found)[2] > 30


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (law("armature", 0, inertia=0.1), law("link_inertia", 0)),
        (law("payload", 2), law("link_inertia", 2)),
        (law("encoder_offset", 2, offset=1e-3), law("link_inertia", 2)),
    ],
    ids=lambda x: x.effect.name,
)
def test_no_motion_distinguishes_twins(one: Law, other: Law) -> None:
    assert tell_apart(simulation("3r"), one, other, FLOOR, 0) == NEVER


@pytest.mark.parametrize(
    ("one", "other", "where"),
    [
        (law("spring", 1, stiffness=2.0, rest=0.1), law("counterbalance", 1), "joint_2"),
        (law("armature", 1, inertia=0.1), law("viscous_friction", 1), "joint_2"),
        (law("load_friction", 2, coefficient=0.1), law("coulomb_friction", 2), "joint_3"),
        (law("time_delay", 0, 1, 2, delay=0.01), law("torque_lag", 0, 1, 2), "joint"),
        (law("joint_coupling", 1, 2, inertia=0.02, viscous=0.1, coulomb=0.1), law("viscous_friction", 1), "joint"),
    ],
    ids=lambda x: x.effect.name if isinstance(x, Law) else "",
)
def test_a_motion_distinguishes_two_laws(one: Law, other: Law, where: str) -> None:
    text = tell_apart(simulation("3r"), one, other, FLOOR, 0)
    assert text.startswith(where) and " from " in text and "standard deviations apart" in text
    assert "signid excite ROBOT --separate" in text and one.effect.name in text and other.effect.name in text
    assert text == tell_apart(simulation("3r"), one, other, FLOOR, 0)
    louder = tell_apart(simulation("3r"), one, other, 100 * FLOOR, 0)
    assert _apart(louder) == pytest.approx(_apart(text) / 100, rel=0.1)  # noise makes it harder


def _apart(text: str) -> float:
    return float(text.split("sets them ")[1].split()[0])


@pytest.mark.slow_cases(but="planted1")
@pytest.mark.parametrize(
    ("robot", "planted", "own", "twin"),
    [
        ("3r", fault("armature", 1, inertia=0.03), "armature", ("link_inertia", (0,))),
        ("3r", fault("encoder_offset", 3, offset=0.05), "encoder_offset", ("link_inertia", (2,))),
        ("3r", fault("payload", mass=0.2, first_moment_x=0.03, first_moment_y=0.0, first_moment_z=0.0),
         "payload", ("link_inertia", (2,))),
        ("1r", fault("quadratic_friction", 1, coefficient=0.5), "fluid_drag", ("quadratic_friction", (0,))),
        ("1r", fault("encoder_offset", 1, offset=0.2), "encoder_offset", ("counterbalance", (0,))),
    ],
)  # fmt: skip
def test_structural_twins_are_listed(robot: str, planted: Any, own: str, twin: tuple[str, tuple[int, ...]]) -> None:
    found = look(robot, planted)
    listed = {(a.law.effect.name, a.law.joints): a for a in found.findings[0].alternatives}
    together = {*listed, named(found)[0]}
    assert twin in together and own in {name for name, _ in together} and found.verdict == "named"
    other = listed.get(twin, next(iter(listed.values())))
    assert other.separating_motion == (NEVER if other.probability > PLAUSIBLE_PROBABILITY else "")
    assert sum(a.probability for a in found.findings[0].alternatives) + found.findings[0].probability <= 1 + 1e-9


def test_a_law_with_more_parameters_is_described_so() -> None:
    plain, wider = (Law(EFFECTS[name], (1,), EFFECTS[name].example) for name in ("spring", "cable_torque"))
    assert tell_apart(simulation("3r"), plain, wider, FLOOR, 0).endswith("it does what spring does, by more numbers")
    assert "standard deviations apart" in tell_apart(simulation("3r"), wider, plain, FLOOR, 0)


def test_a_changed_link_keeps_its_torque_where_its_mass_is_not_identifiable() -> None:
    """The posterior says which numbers of the link are free; the projection moves these and no others."""
    model, base = simulated(), build_base(ARM)
    change, own = model.inertials[1] * 0.3, slice(10, 20)
    hidden = np.linalg.svd(base.combination[:, own])[2][np.linalg.matrix_rank(base.combination[:, own]) :]
    seen = np.eye(10) - hidden.T @ hidden
    found = seen @ change  # as a fit finds it: nothing where torque shows nothing
    link = law("link_inertia", 1, **dict(zip(EFFECTS["link_inertia"].linear(), found, strict=True)))
    group = Group(0, 10, Hypothesis((link,)))
    fit = solve(np.arange(10), 1e12 * seen, 1e12 * found, 1e-2 * np.eye(10))
    wider = extend(model, (), fit, {group: (link,)})
    whole = wider.whole_inertials()
    assert all(np.linalg.eigvalsh(pseudo_inertia(body)).min() > 0 for body in whole)
    off = base.combination[:, own] @ (whole[1] - model.inertials[1] - change)
    assert np.linalg.norm(off) < 0.02 * np.linalg.norm(base.combination[:, own] @ change)
