"""Evaluation of recovered torque signs: right and wrong signs, targets and statistics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import signid
from benchmarks.plants.control import Track
from benchmarks.signs import paper, simulated, summary
from benchmarks.signs.simulated import logged
from benchmarks.signs.trial import Puzzle, Row, Target, Truth, build_row, evaluate, forget, identify, measured, planted
from benchmarks.summary import finite
from signid.regression.session import Options
from signid.signs.result import SignProof, Signs, SignSegment, Trace

T = np.arange(0.0, 10.0, 0.01)
TORQUE = np.column_stack([np.sin(2 * np.pi * 0.25 * T + 0.1), 3 * np.cos(2 * np.pi * 0.25 * T + 0.1)])
TRUTH = Truth(T, TORQUE, TORQUE)


def fake(torque: np.ndarray, flags: tuple[str, ...] = (), confidence: float = 0.9995) -> Signs:
    """Correct signs: one segment between two sign changes, for every joint."""
    parts = []
    for joint, own in enumerate(torque.T):
        ends = [0, *(np.flatnonzero(np.diff(np.sign(own))) + 1).tolist(), len(own)]
        for a, b in zip(ends[:-1], ends[1:], strict=True):
            parts.append(SignSegment(0, joint, T[a], T[b - 1], int(np.sign(own[(a + b) // 2])), confidence))
    return Signs(
        joints=("a", "b"),
        hidden=tuple(range(torque.shape[1])),
        method="exact",
        segments=tuple(parts),
        threshold=np.array([0.1, 0.3]),
        proof=SignProof(True, 0.0, 7),
        flags=flags,
        notes=(),
        value=np.zeros(3),
        noise=np.ones(2),
        inflation=np.ones(2),
        traces=(Trace("", T, np.zeros(1, dtype=int), np.abs(torque), np.sign(torque), torque),),
    )


def row(**changes: object) -> Row:
    """Row that meets its target."""
    score = evaluate(fake(TORQUE), [TRUTH])
    shares, distances, seconds = (1.0, 1.0), (0.0, 1.0, 0.0, 0.0, 0.0), (0.1, 0.2)
    found = (*shares, 5, *distances, (1.0, 2.0), (1.0, 1.0), *seconds, True, 0.0, 3, (), score.judged)
    plain = Row("g", "c", "exact", 10, 10, 0, *found)  # type: ignore[arg-type]
    return replace(plain, **changes)  # type: ignore[arg-type]


def test_correct_signs_are_all_right() -> None:
    score = evaluate(fake(TORQUE), [TRUTH])
    assert (score.right, score.mixed) == (score.segments, 0)
    assert score.samples == score.small == 1


def test_a_wrong_segment_and_wrong_samples_are_detected() -> None:
    signs = fake(TORQUE)
    first, *others = signs.segments
    turned = signs.traces[0].signs.copy()
    turned[:100, 0] *= -1
    traces = (replace(signs.traces[0], signs=turned),)
    score = evaluate(replace(signs, segments=(first._replace(sign=-first.sign), *others), traces=traces), [TRUTH])
    assert score.right == score.segments - 1
    assert not score.judged[0].right
    assert score.samples == pytest.approx(1 - 100 / 2000)
    assert score.small < 1


def test_a_segment_with_both_signs_counts_by_its_majority() -> None:
    signs = fake(TORQUE)
    both = SignSegment(0, 0, 1.0, 2.2, 1, 0.9)
    (judged,) = evaluate(replace(signs, segments=(both,)), [TRUTH]).judged
    assert judged.mixed and judged.right


def test_noise_does_not_change_the_truth_of_samples() -> None:
    noisy = TORQUE + 0.2 * np.random.default_rng(0).standard_normal(TORQUE.shape)
    still = np.outer(T > 4, [1.0, 1.0]) * np.clip(T - 4, 0, 3)[:, None]
    truth = measured(T, still, noisy)
    assert np.mean(np.sign(truth.smooth) == np.sign(TORQUE)) > 0.98 > np.mean(np.sign(noisy) == np.sign(TORQUE))
    assert truth.moving is not None and np.allclose(T[truth.moving][[0, -1]], [4, 7], atol=0.11)


def test_a_row_is_compared_with_its_target() -> None:
    target = Target(segments=1.0, samples=0.99, off=0.01, ratio=1.3, error=1e-3, seconds=2.0)
    assert row(target=target).holds
    for name, value in {
        "right": 9,
        "samples": 0.98,
        "off": 0.02,
        "ratio": np.nan,
        "error": 1.0,
        "seconds": 3.0,
    }.items():
        assert len(row(target=target, **{name: value}).misses) == 1, name
    assert row().worse == 2


def test_flags_and_confidence_are_counted() -> None:
    wrong, flagged = row(right=9), row(ratio=5.0, flags=("impure",))
    group = summary.gather("g", [row(), wrong, flagged, row(flags=("close",))])
    assert (group.runs, group.wrong, group.alarms, group.false_alarms) == (4, 2, 1, 1)
    assert not summary.alarm([group]).met
    judged = row().judged
    bad = row(judged=(judged[0]._replace(right=False), *judged[1:]))
    *_, sure = summary.reliability([bad, flagged])
    assert (sure.segments, sure.right) == (len(judged), len(judged) - 1)
    assert not summary.of_bins([sure]).met


def test_wrong_printed_coefficients() -> None:
    wrong = [entry.name for entry in paper.entries() if entry.wrong]
    assert wrong == [f"pi{k}" for k in (1, 2, 4, 6, 7, 8, 9, 10, 11, 12)]
    assert all(entry.why.startswith("L + d for L - d") for entry in paper.entries() if entry.wrong)
    assert summary.of_table().met


def test_base_parameters_map_to_the_coefficients() -> None:
    arm = signid.load_robot("3r")
    base = signid.inspect(arm, effects=()).base
    found = paper.arm_map(base) @ planted(arm)(base, ())
    assert np.allclose(found, paper.TRUE_3R, rtol=0, atol=1e-8)
    ten = paper.ten_of(base, planted(arm)(base, ()), np.diag(np.arange(1.0, base.rank + 1)))
    assert np.allclose(ten, paper.TRUE_3R, rtol=0, atol=1e-8)
    pendulum = signid.load_robot("1r")
    base = signid.inspect(pendulum, effects=()).base
    assert np.allclose(paper.pendulum_map(base) @ planted(pendulum)(base, ()), paper.TRUE_1R, atol=1e-12)


def test_correct_signs_match_the_signed_identification() -> None:
    robot = signid.load_robot("1r")
    q = np.column_stack([1.2 * np.sin(2 * np.pi * 0.25 * T) + 0.3 * np.sin(2 * np.pi * 0.4 * T)])
    a = np.gradient(np.gradient(q[:, 0], T), T)
    torque = np.column_stack([24.525 * np.sin(q[:, 0]) + 1.67085 * a])
    columns = logged(Track(T, q, torque), 0, 0.02)
    truths = (Truth(T, torque, torque),) * 2
    options = Options(effects=())
    puzzle = Puzzle(
        "g", "c", robot, (columns,), (logged(Track(T, q, torque), 1, 0.02),), options, planted(robot), truths
    )
    found, seconds = identify(puzzle, *puzzle.read(unsigned=False))
    one = fake(torque)
    got = build_row(
        puzzle, "exact", replace(found, signs=replace(one, traces=one.traces * 2)), seconds, Target(ratio=1.0)
    )
    assert got.perfect and got.holds
    assert (got.parameters, got.off, got.ratio) == (3, 0, 1)
    assert got.held_out == got.held_out_known


def test_quantised_torque_has_whole_steps() -> None:
    columns = logged(Track(T, TORQUE, TORQUE), 0, 0.02, step=0.3)
    steps = np.unique(np.diff(np.unique(columns["tau_1"])).round(9))
    assert len(steps) == 1 and steps[0] == pytest.approx(0.3 * np.sqrt(0.5), rel=0.02)


def test_some_joints_keep_their_signs() -> None:
    columns = logged(Track(T, TORQUE, TORQUE), 0, 0.02)
    mixed = forget(columns, (1,))
    assert set(mixed) == {"t", "q_1", "q_2", "abs_tau_1", "tau_2"}
    assert np.array_equal(mixed["abs_tau_1"], np.abs(columns["tau_1"])) and mixed["tau_2"] is columns["tau_2"]
    robot = signid.load_robot("3r", joints=["1", "2"])
    puzzle = Puzzle("g", "c", robot, (columns,), (columns,), signed=(1,))
    (learn,), (judged,) = puzzle.read(unsigned=True)
    assert learn.signed.tolist() == judged.signed.tolist() == [False, True]
    assert all(r.signed.all() for some in puzzle.read(unsigned=False) for r in some)


def test_currents_are_torques_over_their_constants() -> None:
    columns = logged(Track(T, TORQUE, TORQUE), 0, 0.02)
    parts = simulated.currents(columns, np.array([2.0, 4.0]))
    assert set(parts) == {"t", "q_1", "q_2", "abs_current_1", "abs_current_2"}
    assert np.allclose(parts["abs_current_2"] * 4, np.abs(columns["tau_2"]))


def test_a_wrong_description_has_other_masses() -> None:
    robot = signid.load_robot("3r")
    heavy = simulated.heavier(robot, np.array([1.0, 2.0, 0.5]))
    ratio = [b.mass / a.mass for a, b in list(zip(robot.model.inertias, heavy.model.inertias, strict=True))[2:]]
    assert np.allclose(ratio, [2.0, 0.5])


def test_constants_are_counted() -> None:
    judged = row().judged
    one = simulated.Found("none known", "a", (0.01, 0.3), (0.02, 0.1), judged, (), 1.0)
    lost = simulated.Found("none known", "b", (), (), (), (), 3.0, "the torque constant is not known")
    (kind,) = simulated.summarise([one, lost])
    assert (kind.arms, kind.refused, kind.constants, kind.inside) == (2, 1, 2, 1)
    assert (kind.median, kind.largest, kind.seconds) == pytest.approx((0.155, 0.3, 2.0))
    assert all(one.met is None for one in summary.of_constants([kind]))


def test_non_finite_numbers_become_null() -> None:
    assert finite({"a": [np.nan, (1.0, float("inf"))], "b": "c"}) == {"a": [None, [1.0, None]], "b": "c"}
