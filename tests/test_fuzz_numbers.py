"""Extreme numbers in recordings, and motions without information: a flag or a message, never a traceback."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import signid
from signid.diagnose.data import motions
from signid.diagnose.data.dataset import solve
from signid.errors import InputError
from signid.faults.evidence import Amount, amount_fault
from signid.model import Model, stated_inertials
from signid.recording.sampling import samples, select_stretches
from signid.regression.motion import Motion
from signid.regression.session import Options, prepare
from signid.simulation.plant import simulate, track
from signid.types import Trajectory

Columns = dict[str, np.ndarray]
RATE = 100.0
EXPECTED = (InputError,)


@cache
def _waves(seconds: float = 20.0) -> Columns:
    robot, rng = signid.load_robot("3r"), np.random.default_rng(3)
    t = np.arange(0, seconds, 1 / RATE)
    w, phase = 2 * np.pi * rng.uniform(0.1, 1.2, (5, 3)), rng.uniform(0, 6, (5, 3))
    q, v, a = (np.sum(0.2 * w**k * np.sin(w * t[:, None, None] + phase + k * np.pi / 2), axis=1) for k in range(3))
    tau = Motion(robot, t, q, v, a).load + 0.4 * v + 0.3 * np.sign(v) + 0.01 * rng.standard_normal(q.shape)
    columns = {f"{kind}_{j + 1}": x[:, j] for kind, x in (("q", q), ("tau", tau)) for j in range(3)}
    return {"t": t, **columns}


def spoilt(change: Callable[[Columns], object]) -> Columns:
    columns = {name: column.copy() for name, column in _waves().items()}
    change(columns)
    return columns


def put(name: str, where: object, what: object) -> Callable[[Columns], object]:
    return lambda columns: columns[name].__setitem__(where, what)


def each(function: Callable[[np.ndarray], np.ndarray], *kinds: str) -> Callable[[Columns], object]:
    """Every column of some kinds changed."""
    return lambda columns: columns.update({k: function(x) for k, x in columns.items() if k.split("_")[0] in kinds})


TROUBLE = {
    "a joint that rests": put("q_2", ..., 0.3),
    "a joint that rests at zero": put("q_1", ..., 0.0),
    "all joints rest": each(np.zeros_like, "q"),
    "torque zero": put("tau_2", ..., 0.0),
    "all torques zero": each(np.zeros_like, "tau"),
    "torque not a number": put("tau_2", ..., np.nan),
    "position not a number": put("q_2", ..., np.nan),
    "time not a number": put("t", ..., np.nan),
    "infinite": put("tau_3", 50, np.inf),
    "infinite time": put("t", -1, np.inf),
    "huge position": put("q_3", 50, 1e300),
    "huge torque": put("tau_3", slice(50, 60), -1e300),
    "all huge": each(lambda x: x * 1e300, "q", "tau"),
    "large torques": each(lambda x: x * 1e12, "tau"),
    "large positions": each(lambda x: x * 1e6, "q"),
    "denormal torques": each(lambda x: x * 1e-310, "tau"),
    "denormal positions": each(lambda x: x * 1e-310, "q"),
    "denormal time": each(lambda x: x * 1e-310, "t"),
    "time by years": each(lambda x: x * 1e9, "t"),
    "one column twice": lambda columns: columns.update(q_2=columns["q_1"], tau_2=columns["tau_1"]),
    "one column thrice": lambda columns: columns.update(dict.fromkeys(("q_2", "q_3"), columns["q_1"])),
    "position is torque": lambda columns: columns.update(tau_1=columns["q_1"]),
    "every other missing": put("tau_1", slice(None, None, 2), np.nan),
    "no samples": lambda columns: columns.update({k: x[:0] for k, x in columns.items()}),
    "one sample": lambda columns: columns.update({k: x[:1] for k, x in columns.items()}),
    "two samples": lambda columns: columns.update({k: x[:2] for k, x in columns.items()}),
    "nine samples": lambda columns: columns.update({k: x[:9] for k, x in columns.items()}),
    "a step": lambda columns: columns.update(q_1=(columns["t"] > 9) * 1.0),
    "steps": each(np.round, "q"),
    "a ramp": each(lambda x: np.linspace(0, 1, len(x)), "q"),
    "white noise": each(lambda x: np.random.default_rng(0).standard_normal(len(x)), "q", "tau"),
}


@pytest.mark.slow_cases("thrice-True|large positions")
@pytest.mark.parametrize(
    ("name", "unsigned"), [*((name, False) for name in TROUBLE), *((name, True) for name in [*TROUBLE][::2])]
)
def test_extreme_numbers_are_reported_by_identify(name: str, unsigned: bool) -> None:
    robot, columns = signid.load_robot("3r"), spoilt(TROUBLE[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = signid.identify(robot, [signid.read_recording(columns, robot, unsigned=unsigned)])
        except EXPECTED as error:
            assert 20 < len(str(error)) < 400
            return
    assert np.isfinite(found.parameters.values).all() and np.isfinite(found.base_value).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", [x for x in TROUBLE if "large" in x or "rests" in x or "twice" in x or "step" in x])
def test_extreme_numbers_are_reported_by_diagnose(name: str) -> None:
    diagnosed(spoilt(TROUBLE[name]))


def diagnosed(columns: Columns) -> None:
    model = signid.load_model("3r")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = signid.diagnose(model, [signid.read_recording(columns, model.robot)])
        except EXPECTED as error:
            assert 20 < len(str(error)) < 400
            return
    assert all(np.isfinite(list(law.parameters.values())).all() for law in found.model.laws)


def test_a_joint_that_moves_in_jerks_is_diagnosed() -> None:
    columns = spoilt(lambda _: None)
    beat = (columns["t"] % 0.5) / 0.2
    warped = np.floor(columns["t"] / 0.5) * 0.5 + 0.5 * np.clip(beat, 0, 1) ** 2 * (3 - 2 * np.clip(beat, 0, 1))
    columns["q_3"] = np.interp(warped, columns["t"], columns["q_3"])
    diagnosed(columns)


def test_the_recommended_duration_exceeds_the_recorded_one() -> None:
    for seconds, whole in ((22.4, 32.0), (31.99, 31.99)):
        sentence = amount_fault(Amount(100, 41, seconds, 1.0001 * seconds, whole), 7).sentence
        assert float(sentence.split("record for ")[1].split(" s")[0]) > whole + 0.5, sentence


def test_equations_made_indefinite_by_rounding_are_solved() -> None:
    gram = np.ones((3, 3)) - 1e-10 * np.eye(3)
    found = solve(np.arange(3), gram, np.ones(3), 1e-14 * np.eye(3))
    assert np.isfinite(found.value).all()


def test_a_link_may_have_the_name_of_a_joint() -> None:
    robot = signid.load_robot("anymal_c", joints=["LF_HAA", "LF_HFE", "LF_KFE"])
    model = Model(robot, stated_inertials(robot), ())
    t = np.arange(0, 1, 0.01)
    q = 0.1 * np.sin(2 * np.pi * t)[:, None] * np.ones(3)
    motion = Trajectory(robot.joints, t, q, np.gradient(q, t, axis=0), 0 * q)
    assert len(simulate(model, track(model, motion), 0.5).t)


def test_stretches_of_a_long_recording_are_used_with_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motions, "JOINT_SECONDS", 9 * 12.0)
    monkeypatch.setattr(motions, "MIN_SECONDS", 1.0)
    robot = signid.load_robot("3r")
    whole = prepare(robot, [signid.read_recording(_waves(80.0), robot)], [], Options(effects=()))
    cut = motions.subsample(whole)
    ((recording, train),) = cut.train
    assert train.duration == pytest.approx(12, rel=0.02)
    assert [s.first for s in train.stretches] == sorted(s.first for s in train.stretches)
    assert train.stretches[0].first == 0
    assert train.stretches[-1].first + train.stretches[-1].count == whole.train[0][1].stretches[0].count
    for span in train.spans:
        found = samples(recording, train, span, 0, 5)
        first = train.stretch(span).first
        assert found.q[:, 0] == pytest.approx(_waves(80.0)["q_1"][first : first + 5])
    assert "evenly spread" in cut.notes[-1]
    assert select_stretches(whole.train[0][1], 1e6) is whole.train[0][1]
    monkeypatch.setattr(motions, "JOINT_SECONDS", 1e9)
    assert motions.subsample(whole) is whole
