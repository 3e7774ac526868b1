"""Factors in a file: they give the results of the recordings, add up, and refuse mismatched parts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from factored import assert_close, columns, desired, states

import signid
from signid.errors import OptionError, RecordingError, RobotError
from signid.estimation.least_squares import estimate
from signid.identify import Identification
from signid.regression.factors import Node, cascade, reduce_rows, total
from signid.regression.reduced import Reduced, add_up, encode_factors, is_factor_file, load_factors, reduce
from signid.regression.session import Options, prepare
from signid.types import Array, Recording, Robot

ARM = Path(__file__).parents[1] / "robots" / "3r"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return signid.load_robot("3r")


@pytest.fixture(scope="module")
def long(robot: Robot) -> Recording:
    return signid.read_recording(columns(robot, 0), robot)


@pytest.fixture(scope="module")
def whole(robot: Robot, long: Recording) -> Reduced:
    return reduce(robot, [long])


def saved(place: Path, found: Reduced, name: str = "factors.npz") -> str:
    (place / name).write_bytes(encode_factors(found))
    return str(place / name)


def numbers(found: Identification) -> list[Array]:
    fit = found.fit
    bases = [found.base_value, found.estimate.value, found.estimate.covariance, found.parameters.values]
    return [*bases, fit.train_rms, fit.held_out_rms, fit.held_out_r2, fit.noise_floor, found.excitation.shares]


def assert_same(ours: Identification, theirs: Identification) -> None:
    """The same answer to 1e-12 of its largest number, and the same words."""
    for a, b in zip(numbers(ours), numbers(theirs), strict=True):
        assert np.abs(a - b).max() <= 1e-12 * np.abs(b).max()
    assert (ours.notes, ours.flags, ours.inputs) == (theirs.notes, theirs.flags, theirs.inputs)


CASES: dict[str, tuple[bool, dict[str, Any], Options]] = {
    "default": (False, {}, Options()),
    "instruments": (True, {}, Options()),
    "white noise, another cut-off": (False, {}, Options(whiten=False, cutoff=6.0)),
    "nearest standard parameters": (False, {"method": "wls"}, Options(effects=("viscous_friction",))),
}


@pytest.mark.parametrize("case", CASES)
def test_factors_in_a_file_answer_as_the_recordings_do(case: str, robot: Robot, tmp_path: Path) -> None:
    wide, asked, options = CASES[case]
    one, other = (columns(robot, seed, 60.0) for seed in (0, 1))
    given = [signid.read_recording(desired(x) if wide else x, robot) for x in (one, other)]
    if wide:
        given = given[:1]
    direct = signid.identify(robot, given, options=options, **asked)
    found = load_factors(saved(tmp_path, reduce(robot, given, options=options)), robot)
    again = signid.identify(robot, found, options=replace(options, cutoff=None), **asked)
    assert_same(again, direct)
    assert all(np.array_equal(a, b) for a, b in zip(numbers(again), numbers(direct), strict=True))


def test_a_held_out_recording_and_held_joints_are_kept(robot: Robot, tmp_path: Path) -> None:
    held = signid.load_robot("3r", lock={"joint_2": 0.4})
    one, other = ({k: x if k == "t" else x[:, [0, 2]] for k, x in columns(robot, s, 60.0).items()} for s in (0, 1))
    given = [
        signid.read_recording(
            {"t": x["t"]} | {f"{k}_{j}": x[k][:, i] for k in ("q", "tau") for i, j in ((0, 1), (1, 3))}, held
        )
        for x in (one, other)
    ]
    direct = signid.identify(held, given[:1], held_out=given[1:])
    path = saved(tmp_path, reduce(held, given[:1], held_out=given[1:]))
    assert_same(signid.identify(held, load_factors(path, held)), direct)
    with pytest.raises(RobotError, match="--lock"):
        load_factors(path, signid.load_robot("3r", lock={"joint_2": 0.5}))


@pytest.mark.parametrize("parts", [2, 3, 7])
def test_parts_add_up_to_the_whole_to_the_last_bit(
    parts: int, robot: Robot, long: Recording, whole: Reduced, tmp_path: Path
) -> None:
    made = [reduce(robot, [long], share=(k + 1, parts)) for k in range(parts)]
    assert all(sum(node.factors.rows for node in part.train) > 0 for part in made)
    files = [saved(tmp_path, part, f"{k}.npz") for k, part in enumerate(made)]
    found = add_up([load_factors(path, robot) for path in reversed(files)])
    assert encode_factors(found) == encode_factors(whole)


def test_parts_reach_over_recordings_and_gaps(robot: Robot, long: Recording, whole: Reduced) -> None:
    other = signid.read_recording(columns(robot, 2, 120.0), robot)
    given = {"recordings": [long, other], "held_out": [signid.read_recording(columns(robot, 3, 60.0), robot)]}
    expected = reduce(robot, **given)
    parts = [reduce(robot, **given, share=(k + 1, 5)) for k in range(5)]
    assert_close(add_up(parts).train[0].factors, expected.train[0].factors, 0.0)
    assert_same(signid.identify(robot, add_up(parts)), signid.identify(robot, **given))


def test_the_order_of_sums_follows_from_their_numbers_alone(whole: Reduced) -> None:
    one = whole.held_out[0].factors
    leaves = [Node(k, 0, replace(one, rows=2**k)) for k in range(13)]
    stack = cascade(leaves)
    assert [(node.start, node.level) for node in stack] == [(0, 3), (8, 2), (12, 0)]
    for cut in (1, 2, 5, 8, 12):
        merged = cascade([*cascade(leaves[:cut]), *cascade(leaves[cut:])])
        assert [(node.start, node.level) for node in merged] == [(0, 3), (8, 2), (12, 0)]
        assert total(merged).rows == 2**13 - 1  # type: ignore[union-attr]
    assert total([]) is None and reduce_rows(whole.task, ()).rows == 0


def test_days_that_are_reduced_alike_add_up(robot: Robot, tmp_path: Path) -> None:
    days = [signid.read_recording(columns(robot, seed, 60.0), robot) for seed in range(3)]
    first = reduce(robot, days[:1])
    rest = [reduce(robot, [day], like=load_factors(saved(tmp_path, first), robot)) for day in days[1:]]
    found = add_up([first, *rest])
    assert [file.sha256 for file in found.inputs] == [day.sha256 for day in days]
    session = prepare(robot, days[:1])
    parts = [part for day in days for part in prepare(robot, [day]).train]
    direct = session.reduce(parts)
    assert_close(found.train[0].factors, direct, 1e-12)
    ours, theirs = (estimate(f, session.task.base) for f in (found.train[0].factors, direct))
    assert np.abs(ours.value - theirs.value).max() <= 1e-12 * np.abs(theirs.value).max()
    alone = estimate(first.train[0].factors, session.task.base)
    assert np.median(ours.std / alone.std) < 0.7


def test_mismatched_parts_are_refused(robot: Robot, long: Recording, whole: Reduced) -> None:
    short = signid.read_recording(columns(robot, 4, 60.0), robot)
    plain = reduce(robot, [short])

    def refuse(parts: Sequence[Reduced], why: str) -> None:
        with pytest.raises(OptionError, match=why):
            add_up(parts)

    refuse([], "no factors")
    refuse([whole, whole], "given twice")
    refuse([whole, reduce(robot, [short], options=Options(cutoff=5.0))], "filters differ.*--like")
    refuse([whole, reduce(robot, [short], options=Options(effects=("armature",)))], "laws differ")
    refuse([plain, reduce(robot, [long], options=Options(whiten=False), like=plain)], "white noise")
    refuse([reduce(robot, [long], share=(k, 3)) for k in (1, 3)], "part 2 of the 3 parts of .* is missing")
    refuse([reduce(robot, [long], share=(1, 2)), whole], "cut in two different ways")
    refuse([whole, reduce(robot, [short, long], like=whole)], "same samples")
    held = signid.load_robot("3r", lock={"joint_3": 0.1})
    two = {k: x if k == "t" else x[:, :2] for k, x in columns(robot, 5, 60.0).items()}
    refuse([whole, reduce(held, [signid.read_recording(two, held)])], "robot or its held joints differ")
    with pytest.raises(OptionError, match="one part of 2"):
        signid.identify(robot, reduce(robot, [long], share=(1, 2)))
    with pytest.raises(OptionError, match="not of panda"):
        signid.identify(signid.load_robot("panda"), whole)
    for options in ({"held_out": [short]}, {"options": Options(robust=True)}):
        with pytest.raises(OptionError, match="instead of their factors"):
            signid.identify(robot, whole, **options)  # type: ignore[arg-type]


def test_recordings_that_cannot_be_reduced_are_refused(robot: Robot, long: Recording, whole: Reduced) -> None:
    lost = {"t": states(0, 20.0)[0], "q": states(0, 20.0)[1], "abs_tau": np.abs(states(0, 20.0)[1])}
    slow = {k: x[::2] for k, x in columns(robot, 6, 60.0).items()}
    with pytest.raises(RecordingError, match=r"without its sign.*signed\.csv"):
        reduce(robot, [signid.read_recording(lost, robot)])
    with pytest.raises(RecordingError, match="100 Hz.*200 Hz"):
        reduce(robot, [signid.read_recording(slow, robot)], like=whole)
    with pytest.raises(OptionError, match="no part 4 of 3"):
        reduce(robot, [long], share=(4, 3))
    with pytest.raises(OptionError, match="weights"):
        reduce(robot, [long], options=Options(robust=True))
    with pytest.raises(OptionError, match="each recording once"):
        reduce(robot, [long, long])


def test_a_file_is_small_and_the_same_every_time(robot: Robot, whole: Reduced, tmp_path: Path) -> None:
    minute = reduce(robot, [signid.read_recording(columns(robot, 0, 60.0), robot)])
    sizes = [len(encode_factors(found)) for found in (whole, minute)]
    assert max(sizes) < 180_000 and sizes[0] < 1.1 * sizes[1]
    path = saved(tmp_path, whole)
    assert encode_factors(load_factors(path, robot)) == encode_factors(whole) == Path(path).read_bytes()
    assert is_factor_file(path) and not is_factor_file(ARM / "recording.parquet") and not is_factor_file("none.npz")


def test_a_file_without_a_sample_of_rows_is_read(robot: Robot, whole: Reduced, tmp_path: Path) -> None:
    """As earlier versions wrote it; intervals then count noise alone."""
    node = whole.train[0]
    old = replace(whole, train=(node._replace(factors=replace(node.factors, sample=None)),))
    found = load_factors(saved(tmp_path, old), robot)
    assert found.train[0].factors.sample is None
    now = load_factors(saved(tmp_path, whole, "now.npz"), robot).train[0].factors.sample
    assert now is not None and node.factors.sample is not None
    assert np.array_equal(now.columns, node.factors.sample.columns) and now.stride == node.factors.sample.stride
    known, alone = signid.identify(robot, whole).estimate, signid.identify(robot, found).estimate
    assert np.array_equal(known.value, alone.value) and np.all(known.std >= alone.std)


def test_a_damaged_file_is_refused(robot: Robot, whole: Reduced, tmp_path: Path) -> None:
    content = encode_factors(whole)
    rng = np.random.default_rng(0)
    for k in range(60):
        broken = bytearray(content)
        broken[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        (tmp_path / "broken.npz").write_bytes(broken[: len(content) - (1000 if k % 10 == 0 else 0)])
        try:
            found = load_factors(tmp_path / "broken.npz", robot)
        except (OptionError, RobotError) as error:
            assert "broken.npz" in str(error)
        else:  # a bit that archives do not use
            assert encode_factors(found) == content
    np.savez(
        tmp_path / "other.npz", header=np.frombuffer(json.dumps({"schema": "x/1", "sha256": ""}).encode(), np.uint8)
    )
    with pytest.raises(OptionError, match=r"other\.npz holds 'x/1'"):
        load_factors(tmp_path / "other.npz", robot)
    with pytest.raises(OptionError, match="cannot read factors"):
        load_factors(tmp_path / "none.npz", robot)


def test_arrays_of_another_shape_are_refused(robot: Robot, whole: Reduced, tmp_path: Path) -> None:
    node = whole.train[0]
    grown = replace(node.factors, velocity=np.zeros((2, 2)))
    with pytest.raises(OptionError, match="damaged"):
        load_factors(saved(tmp_path, replace(whole, train=(Node(0, 0, grown),))), robot)
