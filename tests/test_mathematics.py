"""Pages of mathematics name existing files and functions, and state what these compute."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import logsumexp, stdtr
from scipy.stats import multivariate_normal, norm

from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.data.noise import project
from signid.diagnose.evidence.bayes_factors import log_bayes_factor, stack_priors
from signid.diagnose.evidence.prior import CoefficientPrior, coefficient_prior, log_prior
from signid.diagnose.search.contributions import steadiness
from signid.diagnose.search.iterate import _expected
from signid.diagnose.thresholds import EFFECT_SIZES
from signid.effects import EFFECTS, LISTED_LAWS
from signid.servo.diagnose import search as servo_search
from signid.servo.fit import normal as normal_module
from signid.servo.fit.coordinates import Coordinates, Slot
from signid.servo.fit.fit import damped
from signid.servo.fit.normal import FitPoint, cost, covariance, normal
from signid.servo.identify.fits import mass_ratio
from signid.servo.identify.identifiable import known_load_share
from signid.servo.plant.torque import Drives, actuate, advance_speeds, drive_torque, new_state
from signid.servo.search.choice import law_probabilities
from signid.servos import DRIVE_LAWS, LOOP_NUMBERS, Servo
from signid.types import Array, Law

PACKAGE = Path(__file__).parents[1] / "signid"
ROOMS = ("diagnose", "servo", "signs")
NAME = re.compile(r"`([A-Za-z_][\w/]*(?:\.\w+)*)`")
FEWEST = 25  # places that a page names


def definitions(path: Path) -> dict[str, set[str]]:
    """Names that a file defines -> names that these define in turn."""
    found: dict[str, set[str]] = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        inner = {str(x) for child in getattr(node, "body", ()) for x in _targets(child)}
        found |= {name: inner if isinstance(node, ast.ClassDef) else set() for name in _targets(node)}
    return found


def _targets(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        yield node.name
    for target in [*getattr(node, "targets", ()), getattr(node, "target", None)]:
        yield from (leaf.id for leaf in ast.walk(target) if isinstance(leaf, ast.Name)) if target else ()


def unresolved(text: str, room: Path) -> Iterator[tuple[str, bool]]:
    """Each file, function or method of the room that a page names, and whether it is there."""
    files = {path.relative_to(room).with_suffix("").as_posix(): path for path in sorted(room.rglob("*.py"))}
    stems = {path.stem: path for path in files.values()}
    classes = {name: inner for path in files.values() for name, inner in definitions(path).items() if inner}
    for name in dict.fromkeys(NAME.findall(text)):
        first, *rest = name.removesuffix(".py").split(".")
        file = files.get(first) if "/" in first else stems.get(first)
        if "/" in first and (room / first).is_dir():
            continue
        if "/" in first or (file is not None and rest):
            there = file is not None and _holds(definitions(file), rest)
            yield name, there
        elif first in classes and rest:
            yield name, rest[0] in classes[first]


def _holds(defined: dict[str, set[str]], rest: list[str]) -> bool:
    return not rest or (rest[0] in defined and (len(rest) == 1 or rest[1] in defined[rest[0]]))


@pytest.mark.parametrize("room", ROOMS)
def test_names_on_pages_of_mathematics_exist(room: str) -> None:
    named = list(unresolved((PACKAGE / room / "README.md").read_text(encoding="utf-8"), PACKAGE / room))
    assert [name for name, there in named if not there] == []
    assert len(named) >= FEWEST


def test_a_missing_name_is_found() -> None:
    text = "`search/stepwise.nothing`, `evidence/nowhere`, `Selection.nothing`, `search/stepwise.prune`, `signid`"
    assert [name for name, there in unresolved(text, PACKAGE / "diagnose") if not there] == [
        "search/stepwise.nothing",
        "evidence/nowhere",
        "Selection.nothing",
    ]


def torque(law: str, error: float, v: float, **numbers: float) -> float:
    """Torque of a drive at an error and a speed; the command moves at .5, voltage is .8, firmware gain 1.2."""
    p = np.zeros(len(LOOP_NUMBERS))
    for name, value in {"kp": 10.0, "kd": 0.3, "effort_limit": 2.0, "speed_limit": 4.0, **numbers}.items():
        p[LOOP_NUMBERS.index(name)] = value
    at, command, supply = (0.0, v), (error, 0.5, 0.1), (0.8, 1.2)
    return float(drive_torque.py_func(p, DRIVE_LAWS.index(law), at, command, supply)[2])


def test_drives_give_the_torque_of_the_page() -> None:
    assert torque("effort", 0.1, 1.0) == pytest.approx(1.2 * 10 * 0.1 + 0.3 * 0.5 + 0.1 - 0.3 * 1.0)
    assert torque("effort", 0.1, 1.0, dead_band=0.04) == pytest.approx(1.2 * 10 * 0.06 + 0.15 + 0.1 - 0.3)
    assert torque("effort", 0.9, 1.0) == 2.0
    assert torque("torque_speed", 0.9, 1.0) == pytest.approx(2.0 * (1 - 1.0 / 4.0))
    assert torque("torque_speed", 0.9, -1.0) == 2.0  # against the motion
    assert torque("duty", 0.9, 1.0) == pytest.approx(0.8 * 2.0 + 0.3 * 0.5 - 0.3 * 1.0)
    assert torque("effort", 0.9, 1.0, droop=0.5) == pytest.approx(2.0 / (1 + 0.5 * 2.0))


def test_friction_and_spring_of_a_joint_are_those_of_the_page() -> None:
    own = {"kp": 10.0, "effort_limit": np.inf, "coulomb_friction": 0.2, "load_friction": 0.1, "viscous_friction": 0.05}
    own |= {"stribeck_level": 0.3, "stribeck_velocity": 0.4, "spring_stiffness": 2.0, "spring_rest": 0.1}
    own |= {"position_amplitude": 0.07, "position_frequency": 2.0, "position_phase": 0.5, "torque_offset": 0.6}
    own |= {"gear_exponent": 1.4, "gear_velocity": 0.2, "gear_level": 0.05, "gear_load": 0.03, "gear_external": 0.7}
    own |= {"gear_load_at_rest": 0.02, "gear_external_at_rest": 0.4}
    own |= {"gear_quadratic_motor": 0.003, "gear_quadratic_external": 0.004}
    numbers = np.array([[[own.get(name, 0.0) for name in LOOP_NUMBERS]]])
    commands, one = np.zeros((7, 1, 1)), np.ones((1, 1))
    commands[0] = 0.9
    drives = Drives(numbers, np.zeros((1, 1), int), np.zeros((1, 1), int), commands, one, one, one, 1, 0.002)
    out, q, v, tau = np.zeros((5, 1)), 0.3, -0.25, 6.0
    for load, quadratic in ((2.0, 0.004 * 2**2), (7.0, 0.003 * 6**2), (-2.0, 0.0)):
        actuate(drives, 0, 0, (np.array([q]), np.array([v]), np.array([load])), out)
        dry = 0.2 + 0.1 * tau + 0.3 * np.exp(-((v / 0.4) ** 2)) + 0.07 * np.sin(2 * q + 0.5)
        at_rest = 0.05 + 0.02 * abs(tau + 0.4 * load) + quadratic
        dry += 0.03 * abs(tau + 0.7 * load) + np.exp(-((0.25 / 0.2) ** 1.4)) * at_rest
        assert out[:3, 0] == pytest.approx([tau - 0.6 - 2.0 * (q - 0.1), 0.05, dry])


@pytest.mark.parametrize("v", [(0.0, 0.0), (0.002, 0.3), (0.5, -0.4)], ids=["rest", "stops", "slides"])
def test_speeds_minimise_energy_and_friction(v: tuple[float, float]) -> None:
    mass, h, state = np.array([[0.4, 0.1], [0.1, 0.2]]), 0.002, new_state(2)
    state.v[:], state.armature[:], state.loads[:] = v, (0.05, 0.02), (1.0, -0.5)
    state.act[:3] = (0.2, 0.7), (0.3, 0.1), (3.0, 0.4)  # constant torque, damping, bound of friction
    a, d, bound = state.act[:3]
    whole, start = mass + np.diag(state.armature), state.v.copy()
    right = (whole - h / 2 * np.diag(d)) @ start + h * (a - state.loads)

    def energy(x: Array) -> float:
        return float(x @ (whole + h / 2 * np.diag(d)) @ x / 2 - x @ right + h * np.abs(x) @ bound)

    advance_speeds(state, mass, h)
    options = {"xatol": 1e-10, "fatol": 1e-18, "maxiter": 4000}
    best = min(
        (minimize(energy, at, method="Nelder-Mead", options=options) for at in (start, state.v)), key=lambda x: x.fun
    )
    np.testing.assert_allclose(state.v, best.x, atol=1e-6)
    assert energy(state.v) <= best.fun + 1e-15


def test_eliminated_states_give_the_step_of_dense_least_squares(monkeypatch: pytest.MonkeyPatch) -> None:
    random, windows, rows, sigma = np.random.default_rng(5), 4, 6, np.array([0.02, 0.05])
    by_value, by_state = random.normal(size=(2, windows, rows, 2)), random.normal(size=(4, windows, rows, 2))
    measured, q0, v0 = random.normal(size=(windows, rows, 2)), np.zeros((windows, 2)), np.zeros((windows, 2))

    def shoot(_: Any, values: Array, q: Array, v: Array) -> tuple[Array, None]:
        states = np.concatenate([q, v], axis=-1)
        return np.einsum("cp,pwtn->cwtn", values, by_value) + np.einsum("cws,swtn->cwtn", states, by_state), None

    slots = Slot(0, "torque_offset", 1.0), Slot(1, "torque_offset", 1.0)
    where = Coordinates((Servo(), Servo()), slots)
    monkeypatch.setattr(Coordinates, "copies", lambda _, values: values)
    monkeypatch.setattr(normal_module, "shoot", shoot)
    stub = SimpleNamespace(measured=measured, q0=q0, v0=v0, longest=rows - 1)
    fake: Any = type("Windows", (SimpleNamespace,), {"__len__": lambda _: windows, "part": lambda own, _: own})(
        **vars(stub)
    )
    point = FitPoint(np.array([0.3, -0.2]), q0 + 0.001, v0 - 0.05)
    slopes, left = normal_module.slopes_at(fake, where, point), normal_module.residuals(fake, where, point)
    here = normal(fake, slopes, left, point, sigma)
    values = damped(where, here, point.values, damping=0.0)
    state = here.state + np.einsum("wps,p->ws", here.across, values - point.values)
    states = -np.einsum("wsu,wu->ws", here.inverse, state)

    design, target = [], []
    prior = np.diag(1 / np.repeat([2e-3, 0.3], 2))
    start = np.concatenate([point.q0, point.v0], axis=1)
    for w in range(windows):
        own = np.zeros((2 * rows, 2 + 4 * windows))
        own[:, :2] = (by_value[:, w] / sigma).reshape(2, -1).T
        own[:, 2 + 4 * w : 6 + 4 * w] = (by_state[:, w] / sigma).reshape(4, -1).T
        held = np.zeros((4, 2 + 4 * windows))
        held[:, 2 + 4 * w : 6 + 4 * w] = prior
        design += [own, held]
        target += [(measured[w] / sigma).ravel(), np.zeros(4)]
    dense = np.linalg.lstsq(np.vstack(design), np.concatenate(target), rcond=None)[0]
    np.testing.assert_allclose(values, dense[:2], rtol=1e-6)
    np.testing.assert_allclose((start + states).ravel(), dense[2:], rtol=1e-6, atol=1e-9)
    left = shoot(None, values[None], (start + states)[None, :, :2], (start + states)[None, :, 2:])[0][0] - measured
    end = FitPoint(values, (start + states)[:, :2], (start + states)[:, 2:])
    squares = np.sum((np.vstack(design) @ dense - np.concatenate(target)) ** 2)
    assert cost(fake, left, end, sigma) == pytest.approx(squares)


def test_a_stiffness_has_the_prior_of_the_page() -> None:
    where = Coordinates((Servo(),), (Slot(0, "kp", 10.0, usual=20.0), Slot(0, "armature", 0.01)))
    assert where.prior_cost(np.array([5.0, 0.3])) == pytest.approx((np.log(5.0 / 20.0) / 1.5) ** 2)


def test_the_probability_of_a_law_is_that_of_the_page() -> None:
    random, seconds = np.random.default_rng(2), 9
    scores = {
        law: random.normal(size, 0.3, seconds)
        for law, size in (("effort", 0.0), ("torque_speed", -0.05), ("duty", 0.1))
    }
    share = dict.fromkeys(scores, 0.0)
    draws = np.random.default_rng(0).dirichlet(np.ones(seconds), 2000)
    for p in draws:
        m = {law: (p @ x + np.log(p @ np.exp(2 * x)) / 2) / 2 for law, x in scores.items()}
        best = {law: 0.25 if law == "torque_speed" else 1.0 for law in m if m[law] <= min(m.values()) + 0.05}
        for law, weight in best.items():
            share[law] += weight / sum(best.values()) / len(draws)
    expected = {law: (seconds * x + 1 / 3) / (seconds + 1) for law, x in share.items()}
    assert law_probabilities(scores) == pytest.approx(expected)
    assert law_probabilities(dict.fromkeys(("effort", "torque_speed"), np.zeros(1)))["effort"] == pytest.approx(0.65)


def test_the_covariance_of_drives_is_the_sandwich_of_the_page() -> None:
    random, count = np.random.default_rng(7), 40
    white = random.normal(size=(count, 2)) @ np.array([[2.0, 0.4], [0.0, 1.0]])
    g = white + 0.8 * np.vstack([np.zeros((1, 2)), white[:-1]])
    information = np.array([[90.0, 12.0], [12.0, 30.0]])
    inverse, factor = np.linalg.inv(information), count / (count - 0.4 * 2)
    plain, near = g.T @ g, g.T @ g
    for k in range(1, 4):
        product = g[k:].T @ g[:-k]
        near = near + (1 - k / 4) * (product + product.T)
    plain, near = (factor * inverse @ meat @ inverse for meat in (plain, near))
    variance = np.max([np.diag(plain), np.diag(near), np.diag(inverse)], axis=0)
    size = np.sqrt(variance / np.diag(plain))
    np.testing.assert_allclose(covariance(information, g), plain * np.outer(size, size), rtol=1e-9)


def test_the_scale_of_torque_is_that_of_the_known_load() -> None:
    t = np.linspace(0, 9, 400)
    v, a, load = np.sin(2 * t), 2 * np.cos(2 * t), 0.7 * np.cos(t) + 0.1 * np.cos(2 * t)
    servo = Servo(kp=8.0, kd=0.2, viscous_friction=0.1, armature=0.05, coulomb_friction=0.3)
    whole = load + 0.05 * a + 0.3 * np.tanh(v / 0.05) + 0.3 * v
    own = np.column_stack([a, v, np.tanh(v / 0.05), np.ones_like(t)])
    rest = load - own @ np.linalg.lstsq(own, load, rcond=None)[0]
    expected = np.sqrt(np.mean(load**2) / np.mean(whole**2)), np.sqrt(np.mean(rest**2) / np.mean(whole**2))
    assert known_load_share(load, v, a, servo) == pytest.approx(expected)
    kp, std, stated = np.array([4.0, 9.0]), np.array([0.4, 0.3]), np.array([5.0, 10.0])
    w = (kp / std) ** 2
    ratio = np.exp(np.sum(w * np.log(stated / kp)) / np.sum(w))
    assert mass_ratio(kp, std, stated) == pytest.approx((ratio, ratio / np.sqrt(np.sum(w))))


def test_the_price_of_numbers_of_a_drive_is_that_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(servo_search, "information", lambda *_: np.array([[4.0, 1.0], [1.0, 3.0]]))
    old, new = Slot(0, "kp", 5.0), Slot(0, "kd", 2.0)
    setting = cast(Any, SimpleNamespace(loop=SimpleNamespace(rows=19)))
    last, trial = (cast(Any, SimpleNamespace(where=SimpleNamespace(slots=slots))) for slots in ((old,), (old, new)))
    w = 2.0**2 * (3.0 - 1.0 / 4.0) * 10 / 20
    expected = np.log(np.mean((1 + EFFECT_SIZES**2 * w) ** -0.5))
    assert servo_search.price(setting, last, trial) == pytest.approx(expected)
    assert servo_search.price(setting, trial, trial) == 0.0


def test_whitening_is_the_inverse_square_root_of_the_covariance() -> None:
    z, s = np.random.default_rng(1).normal(size=(12, 5)), 0.7
    values, vectors = np.linalg.eigh(np.eye(12) + s**2 * z @ z.T)
    basis, shrink = project(z, s)
    np.testing.assert_allclose(np.eye(12) - basis @ (shrink[:, None] * basis.T), vectors / np.sqrt(values) @ vectors.T)


def test_the_bayes_factor_is_the_ratio_of_marginal_likelihoods() -> None:
    random = np.random.default_rng(4)
    columns, fitted, y, factor = (
        *(random.normal(size=(15, k)) for k in (2, 3)),
        random.normal(size=15),
        np.diag([0.5, 2.0]),
    )
    noise = np.eye(15) + 1e4 * fitted @ fitted.T  # fitted columns with a wide prior, L = 1e-4
    shrunk = fitted @ np.linalg.solve(fitted.T @ fitted + 1e-4 * np.eye(3), fitted.T)
    own, right = columns.T @ (columns - shrunk @ columns), columns.T @ (y - shrunk @ y)

    def log(mean: Array, more: Array) -> float:
        return float(multivariate_normal.logpdf(y, mean, noise + more))

    free = stack_priors([CoefficientPrior(factor, 0.0, -1)])
    spread = columns @ factor @ factor @ columns.T
    sizes = [log(np.zeros(15), f**2 * spread) for f in (0.006, 0.02, 0.06, 0.2, 0.6, 2.0)]
    expected = logsumexp(sizes) - np.log(6) - log(np.zeros(15), np.zeros((15, 15)))
    assert log_bayes_factor(free, own[None], right[None])[0] == pytest.approx(expected, abs=1e-6)
    here = stack_priors([CoefficientPrior(0.15 * np.eye(2), 1.0, -1)])
    present = log(columns.sum(axis=1), 0.15**2 * columns @ columns.T) - log(np.zeros(15), np.zeros((15, 15)))
    assert log_bayes_factor(here, own[None], right[None])[0] == pytest.approx(present, abs=1e-6)


def test_a_coefficient_that_must_be_positive_has_half_the_prior() -> None:
    own, right = np.array([[[3.0]]]), np.array([[1.2]])
    b = np.linspace(0, 40, 400_001)
    sizes = (0.006, 0.02, 0.06, 0.2, 0.6, 2.0)
    means = [np.trapezoid(2 * norm.pdf(b, 0, f) * np.exp(b * 1.2 - 1.5 * b**2), b) for f in sizes]
    found = log_bayes_factor(stack_priors([CoefficientPrior(np.eye(1), 0.0, 0)]), own, right)[0]
    assert found == pytest.approx(np.log(np.mean(means)), abs=1e-4)


def test_priors_are_those_of_the_page() -> None:
    def law(name: str, joints: tuple[int, ...] = (0,)) -> Hypothesis:
        effect = EFFECTS[name]
        return Hypothesis((Law(effect, joints, effect.example),))

    assert np.exp(log_prior(law("spring"), 6, 30, 1)) == pytest.approx(0.5 * 0.98 / 30 / 6)
    assert np.exp(log_prior(law("cable_torque"), 6, 30, 1)) == pytest.approx(0.5 * 0.98 * 0.3 / 30 / 6)
    assert np.exp(log_prior(law("time_delay"), 7, 30, 1)) == pytest.approx(0.5 * 0.98 * 0.3 / 30 / 7)  # one joint alone
    assert np.exp(log_prior(law("time_delay", (0, 1)), 7, 30, 1)) == pytest.approx(0.5 * 0.98 / 30 / 7)
    assert np.exp(log_prior(Hypothesis(variable="position"), 1, 30, 8)) == pytest.approx(0.5 * 0.02 / 8)
    common = [np.exp(log_prior(law(name, (0, 1)), 1, 1, 1)) / 0.49 for name in LISTED_LAWS if name != "gravity"]
    assert 1 - sum(common) / len(common) == pytest.approx(0.14, abs=0.005)

    square = np.array([[2.0, 0.5], [0.5, 1.0]])
    shaped = coefficient_prior(Hypothesis(variable="position"), square)
    assert shaped is not None and np.trace(
        shaped.covariance_factor.T @ square @ shaped.covariance_factor
    ) == pytest.approx(1)
    for name, std in (("channel_swap", 0.15), ("backlash", 0.4)):
        fixed = coefficient_prior(law(name), np.eye(1))
        assert fixed is not None and (fixed.mean, fixed.covariance_factor[0, 0]) == (1.0, std)


def test_the_dispersion_is_that_of_the_page() -> None:
    data = SimpleNamespace(scale=np.array([40.0, 2.0]), floor=np.array([0.05, 0.1]))
    posterior = SimpleNamespace(evidence=SimpleNamespace(data=data))
    expected = 1.3 * (1 + (0.003 * data.scale / data.floor) ** 2)
    np.testing.assert_allclose(_expected(cast(Any, posterior), None), expected)


def test_steadiness_is_the_test_of_the_page_and_the_prior() -> None:
    random, key = np.random.default_rng(3), ("spring", (0,))
    made, rest = random.uniform(0.05, 0.2, 80), 0.5 * random.normal(size=80)
    group = SimpleNamespace(claim=SimpleNamespace(key=key))
    data = SimpleNamespace(rows=lambda _: [0], raw=lambda *_: made[:, None])
    posterior = SimpleNamespace(evidence=SimpleNamespace(data=data), priors={key: np.log(0.01)})
    found = steadiness(
        cast(Any, posterior), cast(Any, SimpleNamespace(coefficients=_One())), rest[:, None], cast(Any, group)
    )
    size = np.sqrt(np.mean(rest**2))
    gain, energy = (rest * made + made**2 / 2) / size**2, made**2 / size**2
    full = [int(np.searchsorted(np.cumsum(energy), k / 8 * energy.sum())) for k in range(1, 8)]
    edges = (0, *full, 80)  # the row at which a block is full begins the next one
    gains, energies = (np.array([x[a:b].sum() for a, b in pairwise(edges)]) for x in (gain, energy))
    uneven = gains - energies * gains.sum() / energies.sum()
    better = stdtr(7, gains.sum() / np.sqrt(np.sum(uneven**2) * 8 / 7))
    assert found == pytest.approx(np.log(better / (1 - better)) + np.log(0.01 / 0.5))


class _One:
    """The coefficient 1 of every law."""

    def __getitem__(self, _: object) -> Array:
        return np.ones(1)
