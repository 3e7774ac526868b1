"""Time limits: a truncated search is flagged; a limit that is not reached changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signid
from signid.cli import run
from signid.deadline import seconds_left, time_is_up, time_limit
from signid.errors import OptionError
from signid.optimisers import OPTIMISERS, Problem
from signid.types import Recording, Robot

ROBOT = Path(__file__).parents[1] / "robots" / "3r"
AT_ONCE = 1e-9  # s
CUT = "was cut short after 1e-09 s"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return signid.load_robot("3r")


@pytest.fixture(scope="module")
def recording(robot: Robot) -> Recording:
    return signid.read_recording(ROBOT / "recording.parquet", robot)


@pytest.fixture(scope="module")
def lost(robot: Robot) -> Recording:
    return signid.read_recording(ROBOT / "recording.parquet", robot, unsigned=True)


SEARCHES: dict[str, tuple[str, Callable[[Any, Any, Any], Any]]] = {
    "convex": ("the fit of feasible inertials", lambda r, full, lost: signid.identify(r, [full])),
    "pbrp": ("the search for standard parameters", lambda r, full, lost: signid.identify(r, [full], method="pbrp")),
    "signs": ("the search for signs", lambda r, full, lost: signid.identify(r, [lost])),
    "tree": ("the search for standard parameters", lambda r, full, lost: signid.identify(r, [lost], signs="tree")),
    "laws": ("the search for laws", lambda r, full, lost: signid.diagnose(signid.load_model("3r"), [full])),
    "motion": (
        "the search for a motion",
        lambda r, full, lost: signid.excite(signid.load_model("3r"), duration=4),
    ),
}


@pytest.mark.parametrize("name", SEARCHES)
def test_every_search_ends_with_a_flag(name: str, robot: Robot, recording: Recording, lost: Recording) -> None:
    said, verb = SEARCHES[name]
    with time_limit(AT_ONCE):
        found = verb(robot, recording, lost)
    assert [flag for flag in found.flags if flag.startswith(f"{said} {CUT}")]


def test_limits_that_are_long_enough_change_nothing(robot: Robot, recording: Recording) -> None:
    with time_limit(1000.0):
        limited = signid.identify(robot, [recording])
    free = signid.identify(robot, [recording])
    assert np.array_equal(limited.base_value, free.base_value)
    assert limited.flags == free.flags


def test_least_squares_is_no_search(robot: Robot, recording: Recording) -> None:
    with time_limit(AT_ONCE):
        found = signid.identify(robot, [recording], method="wls")
    assert np.array_equal(found.estimate.value, signid.identify(robot, [recording], method="wls").estimate.value)


def test_the_earlier_of_two_limits_counts() -> None:
    assert seconds_left() == np.inf
    with time_limit(1000.0):
        with time_limit(AT_ONCE):
            assert time_is_up("a search")
        assert not time_is_up("a search")
        with time_limit(2000.0):
            assert seconds_left() <= 1000.0
    assert seconds_left() == np.inf


@pytest.mark.parametrize("library", OPTIMISERS.names)
def test_an_optimiser_returns_its_best_point_so_far(library: str) -> None:
    problem = Problem(lambda x: float(x @ x), -np.ones(2), np.ones(2), np.full(2, 0.5))
    with time_limit(AT_ONCE):
        found = OPTIMISERS[library].minimise(problem, budget_evaluations=1000)
    assert (found.status, found.evaluations, found.value) == ("budget", 1, 0.5)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_a_limit_is_positive(seconds: float) -> None:
    with pytest.raises(OptionError, match="give a positive number of seconds"), time_limit(seconds):
        pass


def test_the_command_ends_with_3(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["identify", "3r", str(ROBOT / "recording.parquet"), "-o", str(tmp_path / "out"), "--time-limit", "1e-9"]
    assert run(words) == 3
    assert f"the fit of feasible inertials {CUT}" in capfd.readouterr().err.replace("\n", " ")
    assert (tmp_path / "out" / "identification.json").is_file()


def stopped_by_hand(verb: Callable[[], Any]) -> Any:
    """Result of a verb when its searches are asked to stop after the first answer."""
    from signid import deadline

    with pytest.MonkeyPatch.context() as patch:
        look = deadline.seconds_left
        patch.setattr(deadline, "seconds_left", lambda: (deadline.stop_searches("a test"), look())[1])
        return verb()


def test_a_stop_is_flagged_with_its_cause(robot: Robot, recording: Recording) -> None:
    found = stopped_by_hand(lambda: signid.identify(robot, [recording], method="pbrp"))
    (flag,) = [flag for flag in found.flags if flag.startswith("stopped early by a test: ")]
    assert "the search for standard parameters" in flag and "ended with the best result so far" in flag


def test_a_truncated_fit_is_not_worse_than_least_squares(robot: Robot, recording: Recording) -> None:
    plain = signid.identify(robot, [recording], method="wls")
    with time_limit(AT_ONCE):
        cut = signid.identify(robot, [recording], method="pbrp")
    assert cut.method == "wls" and np.array_equal(cut.base_value, plain.base_value)
    assert any("worse than plain least squares" in flag for flag in cut.flags)


def test_a_diagnosis_without_time_keeps_the_simulation(recording: Recording) -> None:
    given = signid.load_model("3r")
    with time_limit(AT_ONCE):
        found = signid.diagnose(given, [recording])
    assert not found.findings and found.verdict != "named"
    assert np.all(found.after.held_out_rms <= 1.05 * found.before.held_out_rms)
