"""The benchmarks can be run, and judge what they are given."""

from __future__ import annotations

import gzip
import json
import runpy
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from benchmarks.arms import ARMS, load
from benchmarks.concealed import session, stranger
from benchmarks.concealed.cases import SIZES, SUITES, Case, cases, sample
from benchmarks.concealed.evaluate import evaluate
from benchmarks.concealed_real import leave_out, sets, trials
from benchmarks.concealed_real.run import rows_of
from benchmarks.concealed_real.summary import Share, totals
from benchmarks.export_loop import CLOSE, STEPS, recorded, rolled
from benchmarks.plants.bodies import Body
from benchmarks.plants.control import draw_motion
from benchmarks.plants.faults import EFFECTS, FOREIGN
from benchmarks.public import JANOT, Entry, files, published, scored
from benchmarks.servo.robots import benches
from benchmarks.signs import Truth, majority
from benchmarks.summary import LIBRARIES, finite
from benchmarks.watch.plant import PERIOD, Alteration, Push, record

ROOT = Path(__file__).parents[1]
NAMES = (
    *("coverage", "signs", "concealed", "concealed_real", "public", "servo", "servo_faults", "logs", "watch"),
    *("blackbox", "regressor", "export", "export_loop", "figures"),
)


@pytest.mark.filterwarnings("ignore:.*found in sys.modules")
@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_says_what_it_does(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for key, value in LIBRARIES.items():
        monkeypatch.setenv(key, value)  # else the benchmark starts anew with them
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    folder = (ROOT / "benchmarks" / name).is_dir()
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(f"benchmarks.{name}{'.__main__' * folder}", run_name="__main__")
    assert not ended.value.code and f"python -m benchmarks.{name}" in capsys.readouterr().out


def test_every_law_has_a_concealed_case() -> None:
    found = cases(SUITES, ("1r", "3r"), SIZES, range(2))
    assert {effect for case in found for effect in case.effects} == set(EFFECTS) | set(FOREIGN)
    assert len({case.name for case in found}) == len(found) and sample(found, 20, 1) == sample(found, 20, 1)


def test_a_session_does_not_reveal_its_answer(tmp_path: Path) -> None:
    case = Case("exact", "1r", ("coulomb_friction",), 0.05, 0)
    folder = session.make(case, tmp_path)
    names = {path.name for path in folder.iterdir()}
    assert names == {"robot.urdf", "actuators.toml", *(f"recording_{k}.parquet" for k in range(1, 5))}
    answer = json.loads((tmp_path / "answers" / f"{case.name}.json").read_text())
    (fault,) = answer["faults"]
    assert fault["size"] == pytest.approx(0.05) and "coulomb" not in (folder / "actuators.toml").read_text()
    fit = {"held_out_rms": [1.0], "irreducible_rms": [1.0]}
    for effect, outcome in (("coulomb_friction", "right"), ("armature", "wrong")):
        cause = {"effect": effect, "joint": "joint_1", "role": "cause", "probability": 0.99, "parameters": {}}
        document = {"verdict": "named", "findings": [{**cause, "alternatives": []}], "unexplained": []}
        found = evaluate(answer, {"document": {**document, "fit": {"after": fit}}, "cpu": 0.5})
        assert (found.outcome, found.sure) == (outcome, outcome == "wrong")


def test_a_strangers_robot_is_judged_by_what_is_beyond_the_ordinary(tmp_path: Path) -> None:
    block = stranger.cases(24, 0)
    assert {case.kind for case in block} == {*stranger.KINDS, stranger.HEALTHY} and len({c.name for c in block}) == 24
    assert {case.kind for case in stranger.cases(3, 0, ["spring"])} == {"spring"}
    spring = {"effect": "spring", "joint": "joint_2", "parameters": {}}
    body = {"effect": "link_inertia", "joint": "joint_2", "role": "cause", "probability": 0.99, "parameters": {}}
    own, twin = {**body, "alternatives": []}, {**body, "alternatives": [spring]}
    cause, drag = {**own, **spring}, {**own, "effect": "fluid_drag", "joint": None}
    (tmp_path / "run.json").write_text('{"code": 3, "cpu": 9.0}')
    for faults, causes, outcome, sure in (
        ([spring], [own, cause, drag], "right", True),
        ([spring], [twin], "listed", False),
        ([spring], [drag], "wrong", True),
        ([spring], [own], "missed", False),
        ([], [own], "silent", False),
        ([], [drag], "alarm", True),
    ):
        truth = {"kind": "spring" if faults else "healthy", "faults": faults, "joints": ["joint_1", "joint_2"]}
        (tmp_path / "truth.json").write_text(json.dumps(truth))
        (tmp_path / "diagnosis.json").write_text(json.dumps({"verdict": "named", "findings": causes}))
        found = stranger.judge(tmp_path)
        assert (found.outcome, found.sure) == (outcome, sure)
    (tmp_path / "run.json").write_text('{"code": 2, "cpu": 9.0}')
    assert stranger.judge(tmp_path).outcome == "refused"


@pytest.mark.slow
def test_a_known_change_is_judged_beside_its_control(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder := tmp_path / "arm").mkdir()
    (folder / "robot.urdf").write_text((ROOT / "robots/3r/robot.urdf").read_text())
    with gzip.open(folder / "log.csv.gz", "wb") as file:
        pl.read_parquet(ROOT / "robots/3r/recording.parquet").write_csv(file)
    monkeypatch.setenv("SIGNID_DATA", str(tmp_path))
    one = sets.RealSet("arm", "arm", "robot.urdf", *sets.thirds("log", ((0, 8), (8.1, 16), (16.1, 24))))
    control, sign = rows_of(one, ("torque sign",), None)
    assert control["kind"] == "control" and sign["fair"] and sign["outcome"] in ("first", "flag")
    assert totals([control, sign])["named first or flagged (85 %)"] == "100 % (1 of 1)"


def test_a_robot_takes_no_part_in_the_choice_of_its_constants() -> None:
    key = "CHANGED_PROBABILITY"
    said, named = trials.CONSTANTS[key], {"psm": (9, 2, 9), "emps": (5, 6, 5), "panda": (5, 6, 5)}
    rows = [
        {
            "setting": trials.label(trials.setting({key: x})),
            "set": name,
            "fair": True,
            "outcome": outcome,
        }
        for name, counts in named.items()
        for x, n in zip(said.values, counts, strict=True)
        for outcome in ["first"] * n + ["missed"] * (10 - n)
    ]
    found = {one.robot: one for one in leave_out.leave_out(rows, [said], list(named))}
    assert (found["psm"].usual, found["psm"].left_out) == (Share(9, 10), Share(2, 10))
    assert found["panda"].differences == (0, 0)


def test_the_sign_of_a_segment_is_that_of_most_of_its_energy() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    torque = np.where(t < 0.6, 1.0, -2.0)[:, None]
    truth = Truth(t, torque, torque, t >= 0)
    assert majority(truth, 0, 0.0, 0.5) == (1, False) and majority(truth, 0, 0.0, 1.0) == (-1, True)


@pytest.mark.parametrize("event", [Push(1.0, 0.2, 2, (5.0, 5.0, 5.0)), Alteration(1.0, "payload", 2, 0.5)])
def test_an_event_of_the_watch_begins_at_its_time(event: Push | Alteration) -> None:
    arm, robot = ARMS[0], load(ARMS[0])
    quiet, changed = (
        record(Body(robot.document, robot.joints), arm.drives, draw_motion(arm.centre, 2), 2.0, events, 1, noise=0.0)
        for events in ((), (event,))
    )
    change = np.abs([changed[f"tau_{j}"] - quiet[f"tau_{j}"] for j in (1, 2, 3)]).max(axis=0)
    begin = round(1.0 / PERIOD)
    assert change[: begin - 1].max() < 1e-9 < 1e-2 < change[begin:].max()


@pytest.mark.usefixtures("data")
def test_published_parameters_score_as_cited() -> None:
    row = scored(Entry("published", published(), JANOT, 0.0), *files())
    assert row.numbers == 4
    assert row.train == pytest.approx(5.66, abs=0.1) and row.test == pytest.approx(8.87, abs=0.1)


@pytest.mark.slow
def test_exports_of_a_pendulum_repeat_its_recording(tmp_path: Path) -> None:
    (bench,) = benches(tmp_path, ("pendulum",))
    rows = list(rolled(recorded(bench, bench.drives, 1), tmp_path))
    assert len(rows) == 1 + 2 * len(STEPS)
    assert rows[0].whole_signid < CLOSE and rows[0].whole_recording < CLOSE
    assert all(row.rounding > 0 and row.whole_signid < row.rounding + CLOSE for row in rows[1:])


def test_numbers_without_a_value_are_null() -> None:
    assert finite({"a": [np.nan, (1.0, float("inf"))]}) == {"a": [None, [1.0, None]]}
