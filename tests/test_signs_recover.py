"""Torque without signs, from recording to model: as if the signs had been measured."""

from __future__ import annotations

import csv as table
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from motions import Trial, trial
from numpy.testing import assert_allclose

import signid
from signid.cli import run
from signid.errors import RecordingError
from signid.identify import Identification
from signid.regression.session import prepare
from signid.signs import recover
from signid.types import Array, Recording, Robot

ROBOTS = Path(__file__).parents[1] / "robots"


@pytest.fixture(scope="module")
def arm() -> Robot:
    return signid.load_robot("3r")


@pytest.fixture(scope="module")
def made(arm: Robot) -> Trial:
    return trial(arm, seconds=20)


@pytest.fixture(scope="module")
def with_signs(arm: Robot, made: Trial) -> Identification:
    return signid.identify(arm, [made.recording(tau=noisy(made))])


@pytest.fixture(scope="module")
def without(arm: Robot, made: Trial) -> Callable[..., Identification]:
    """Identifications of the same torque without the signs of some joints."""
    return cache(lambda *hidden: signid.identify(arm, [signid.read_recording(lost(made, noisy(made), hidden), arm)]))


def noisy(made: Trial, share: float = 0.02, seed: int = 0) -> Array:
    noise = np.random.default_rng(seed).standard_normal(made.torque.shape)
    return np.asarray(made.torque + share * np.sqrt(np.mean(made.torque**2, axis=0)) * noise)


def lost(made: Trial, torque: Array, hidden: tuple[int, ...] = (0, 1, 2)) -> dict[str, Array]:
    """Columns without the signs of some joints."""
    columns = {"t": made.t}
    for j in range(made.q.shape[1]):
        columns[f"q_{j + 1}"] = made.q[:, j]
        name = f"abs_tau_{j + 1}" if j in hidden else f"tau_{j + 1}"
        columns[name] = np.abs(torque[:, j]) if j in hidden else torque[:, j]
    return columns


def right(found: Identification, made: Trial, torque: Array) -> float:
    """Share of the segments whose sign is that of their torque."""
    assert found.signs is not None
    segments = found.signs.segments
    inside = [torque[(made.t >= s.start) & (made.t <= s.end), s.joint] for s in segments]
    return float(np.mean([np.sign(x @ np.abs(x)) == s.sign for x, s in zip(inside, segments, strict=True)]))


@pytest.mark.parametrize("hidden", [(0, 1, 2), (1,), (0, 2)])
def test_identification_without_signs_is_that_with_them(
    hidden: tuple[int, ...], made: Trial, with_signs: Identification, without: Callable[..., Identification]
) -> None:
    torque, found = noisy(made), without(*hidden)
    assert found.signs is not None
    assert found.signs.hidden == hidden
    assert {segment.joint for segment in found.signs.segments} == set(hidden)
    assert right(found, made, torque) == 1
    assert found.signs.proof.optimal
    assert found.signs.is_certain()
    assert_allclose(
        found.estimate.value, with_signs.estimate.value, atol=0.2 * with_signs.estimate.std.max(), rtol=0.01
    )
    assert_allclose(found.fit.held_out_rms, with_signs.fit.held_out_rms, rtol=0.02)
    assert with_signs.signs is None


def test_signs_of_every_row_are_given_back(made: Trial, without: Callable[..., Identification]) -> None:
    torque = noisy(made)
    (recording,) = without(0, 1, 2).recordings
    assert recording.signed.all()
    signed = recording.read().tau
    assert_allclose(np.abs(signed), np.abs(torque))
    large = np.abs(torque) > 0.1 * np.sqrt(np.mean(torque**2, axis=0))
    assert np.mean(np.sign(signed)[large] == np.sign(torque)[large]) > 0.9995
    assert np.mean(np.sign(signed) == np.sign(torque)) > 0.99


def test_samples_are_missing_between_thinned_ones(arm: Robot) -> None:
    """The spans on either side of it are nearer to each other than thinned samples are."""
    made = trial(arm, seconds=12, rate=1000.0)
    torque = noisy(made)
    columns = lost(made, torque)
    columns["abs_tau_1"][6003:6015] = np.nan
    (recording,) = recover(prepare(arm, [signid.read_recording(columns, arm)])).session.recordings
    signed = recording.read().tau
    assert np.flatnonzero(np.isnan(signed).any(axis=1)).tolist() == list(range(6003, 6015))
    known = ~np.isnan(signed)
    assert np.mean(np.sign(signed[known]) == np.sign(torque[known])) > 0.999


def test_held_out_recordings_take_no_part_in_the_search(
    arm: Robot, made: Trial, without: Callable[..., Identification]
) -> None:
    other = trial(arm, seed=3, seconds=12)
    learn = signid.read_recording(lost(made, noisy(made)), arm)
    judge = signid.read_recording(lost(other, noisy(other, seed=1)), arm)
    by_hand = signid.identify(arm, [learn], held_out=[judge])
    alone = without(0, 1, 2)
    last = signid.identify(arm, [learn, judge])
    assert by_hand.signs is not None and alone.signs is not None and last.signs is not None
    assert by_hand.signs.segments == alone.signs.segments == last.signs.segments
    assert len(by_hand.signs.traces) == 2
    truth = other.recording(tau=noisy(other, seed=1))
    signed = signid.identify(arm, [made.recording(tau=noisy(made))], held_out=[truth])
    assert_allclose(by_hand.fit.held_out_rms, signed.fit.held_out_rms, rtol=0.02)


def test_a_check_is_that_with_signs(arm: Robot, made: Trial) -> None:
    torque = noisy(made)
    wanted = signid.check(arm, [made.recording(tau=torque)])
    found = signid.check(arm, [signid.read_recording(lost(made, torque), arm)])
    assert wanted.signs is None and found.signs is not None and found.signs.is_certain()
    assert found.flags == wanted.flags == ()
    assert found.verdicts == wanted.verdicts
    assert_allclose(found.std, wanted.std, rtol=0.05)


@pytest.mark.slow
def test_a_held_out_recording_whose_signs_the_model_gave_is_noted(arm: Robot, made: Trial) -> None:
    torque, other = noisy(made), trial(arm, seed=3, seconds=12)
    learn, signed = signid.read_recording(lost(made, torque), arm), made.recording(tau=torque)
    judges = signid.read_recording(lost(other, other.torque), arm), other.recording(tau=other.torque)

    def notes_of(*recordings: Recording, judge: Recording | None = None) -> list[str]:
        notes = signid.identify(arm, recordings, held_out=[judge] if judge else []).notes
        return [note for note in notes if "held-out R2 is optimistic" in note]

    assert "with this model and data" in notes_of(learn)[0]
    for (note,) in (notes_of(learn, judges[0]), notes_of(learn, judge=judges[0]), notes_of(signed, judge=judges[0])):
        assert "and data" not in note
    assert notes_of(learn, judges[1]) == notes_of(learn, judge=judges[1]) == notes_of(signed) == []


def test_an_undecided_sign_has_low_confidence() -> None:
    """A pendulum that only swings slowly: its weight on the other side would look the same."""
    robot, t = signid.load_robot("1r"), np.arange(0, 40, 0.01)
    q = 0.5 * np.sin(0.2 * t) + 0.2 * np.sin(0.3 * t + 1)
    a = -0.5 * 0.04 * np.sin(0.2 * t) - 0.2 * 0.09 * np.sin(0.3 * t + 1)
    torque = 24.525 * np.sin(q) + 1.67085 * a + 2 * np.random.default_rng(0).standard_normal(len(t))
    columns = {"t": t, "q_1": q, "abs_tau_1": np.abs(torque)}
    found = signid.identify(robot, [signid.read_recording(columns, robot)], options=signid.Options(effects=()))
    assert found.signs is not None
    assert not found.signs.is_certain()
    assert max(segment.confidence for segment in found.signs.segments) < 0.99
    assert "sign of the torque of joint_1 is not decided" in found.flags[0]
    assert "accelerates harder" in found.flags[0]


def test_the_command_line_finds_signs_and_writes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = ROBOTS / "3r" / "recording.parquet"
    assert run(["identify", "3r", str(file), "--unsigned", "-o", "one"]) == 0
    assert run(["identify", "3r", str(file), "--unsigned", "-o", "two"]) == 0
    assert "proved" in capsys.readouterr().out
    names = {path.name for path in Path("one").iterdir()}
    assert names == {"identification.json", "model.json", "robot.urdf", "report.html", "signed.csv", "signs.html"}
    for name in names:
        assert (Path("one") / name).read_bytes() == (Path("two") / name).read_bytes()
    document = json.loads((Path("one") / "identification.json").read_text())
    assert document["signs"]["proof"]["optimal"] is True
    assert set(document["signs"]["segments"][0]) >= {"joint", "start", "end", "sign", "confidence"}
    assert run(["check", "3r", str(file), "--unsigned"]) == 0
    assert "20 identifiable, 3 weak, 2 unidentifiable" in capsys.readouterr().out
    recorded = signid.read_recording(file, signid.load_robot("3r")).read()
    with (Path("one") / "signed.csv").open() as stream:
        rows = list(table.DictReader(stream))
    assert len(rows) == len(recorded.t)
    tau = np.array([[float(row[f"tau_joint_{j}"]) for j in (1, 2, 3)] for row in rows])
    assert_allclose(np.abs(tau), np.abs(recorded.tau))
    sure = np.array([[float(row[f"sure_joint_{j}"]) for j in (1, 2, 3)] for row in rows])
    same = np.sign(tau) == np.sign(recorded.tau)
    assert 0.6 < np.mean(sure > 0.999) < 0.9 and np.all(same[sure > 0.999])
    assert np.mean(same) > 0.99  # noise is 2 %
    assert np.mean(same[np.abs(tau) > 0.1 * np.sqrt(np.mean(tau**2, axis=0))]) > 0.999


def test_recordings_with_and_without_signs_go_together(arm: Robot, made: Trial) -> None:
    other, judge = trial(arm, seed=3, seconds=12), trial(arm, seed=5, seconds=12)
    bare = signid.read_recording(lost(other, noisy(other, seed=1)), arm)
    judges = [judge.recording(tau=judge.torque)]
    for learn in ([made.recording(tau=noisy(made)), bare], [bare, made.recording(tau=noisy(made))]):
        found = signid.identify(arm, learn, held_out=judges)
        assert np.all(found.fit.held_out_r2 > 0.999)
        assert found.signs is not None and found.signs.hidden == (0, 1, 2)
        assert any("joint_1, joint_2, joint_3, which some recordings have" in note for note in found.notes)


def test_a_torque_that_one_recording_lacks(arm: Robot, made: Trial) -> None:
    other, hidden = trial(arm, seed=3, seconds=12), (0, 1)
    for column, refused in (("abs_tau_2", True), ("tau_3", False)):
        less = {key: x for key, x in lost(other, noisy(other), hidden).items() if key != column}
        for learn in ([lost(made, noisy(made), hidden), less], [less, lost(made, noisy(made), hidden)]):
            recordings = [signid.read_recording(columns, arm) for columns in learn]
            if refused:
                with pytest.raises(RecordingError, match="one recording has torque of joint_2, another has none"):
                    recover(prepare(arm, recordings, [made.recording()]))
            else:
                signs = recover(prepare(arm, recordings, [made.recording()])).signs
                assert signs is not None and signs.hidden == hidden and signs.is_certain()
