"""Every recording is surveyed once; options reach every step."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import signid
from signid.regression import session as preparing
from signid.regression.session import Options, Session, prepare, rearrange
from signid.robot import load_robot
from signid.types import Recording, Robot

RECORDING = Path(__file__).parents[1] / "robots" / "3r" / "recording.parquet"


@pytest.fixture
def surveyed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Recording]]:
    """The recordings that were surveyed, in order."""
    seen, survey = list[Recording](), preparing.survey

    def counted(recording: Recording, robot: Robot) -> object:
        seen.append(recording)
        return survey(recording, robot)

    monkeypatch.setattr(preparing, "survey", counted)
    yield seen


def read(unsigned: bool = False) -> tuple[Robot, Recording]:
    robot = load_robot("3r")
    return robot, signid.read_recording(RECORDING, robot, unsigned=unsigned)


@pytest.mark.parametrize("unsigned", [False, True])
def test_identify_surveys_a_recording_once(unsigned: bool, surveyed: list[Recording]) -> None:
    robot, recording = read(unsigned)
    signid.identify(robot, [recording], method="wls")
    assert surveyed == [recording]


def test_check_surveys_an_unsigned_recording_once(surveyed: list[Recording]) -> None:
    robot, recording = read(unsigned=True)
    signid.check(robot, [recording])
    assert surveyed == [recording]


def test_currents_of_unknown_constants_are_surveyed_once(surveyed: list[Recording]) -> None:
    robot, recording = read()
    rows = recording.read()
    columns = {"t": rows.t} | {f"q_{j + 1}": rows.q[:, j] for j in range(3)}
    columns |= {f"abs_current_{j + 1}": np.abs(rows.tau[:, j]) / 2.0 for j in range(3)}
    given = signid.read_recording(columns, robot)
    found = signid.identify(robot, [given], method="wls")
    assert found.signs is not None and [gain.joint for gain in found.signs.gains] == list(robot.joints)
    assert surveyed == [given]


def test_other_options_need_no_other_survey(surveyed: list[Recording]) -> None:
    robot, recording = read()
    session = prepare(robot, [recording])
    lower = rearrange(robot, session, Options(effects=(), cutoff=4.0))
    again = prepare(robot, [recording], (), Options(effects=(), cutoff=4.0))
    assert surveyed == [recording] * 2 and lower.task.laws == () and lower.task.band.cutoff == again.task.band.cutoff
    assert lower.notes == again.notes and [s.spans for _, s in lower.train] == [s.spans for _, s in again.train]
    np.testing.assert_array_equal(lower.task.base.combination, again.task.base.combination)


def test_the_cut_off_of_a_diagnosis_reaches_the_search_for_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, cutoffs = read(unsigned=True)[1], list[float]()
    module = importlib.import_module("signid.signs.recover")
    recover = module.recover

    def watched(session: Session, **more: object) -> object:
        cutoffs.append(session.task.band.cutoff)
        return recover(session, **more)

    monkeypatch.setattr(module, "recover", watched)
    with signid.time_limit(1e-3):
        signid.diagnose(signid.load_model("3r"), [recording], options=Options(cutoff=5.0))
    assert cutoffs == [5.0]
