"""Constants chosen without the robot that judges: the choice, its figures, constants set for a while, shared steps."""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from benchmarks.concealed_real import leave_out, trials
from benchmarks.concealed_real.summary import Share
from benchmarks.concealed_real.trials import CONSTANTS, ROOT, RUN, TABLE, Setting, applied, setting, shared_steps
from signid.errors import InputError

SAID, GROWTH = CONSTANTS["SAID"], CONSTANTS["MISFIT_GROWTH"]
LESS, MORE = SAID.others
ROBOTS = ["psm", "emps", "panda"]


def rows(name: str, values: Setting, named: int, fair: int = 10) -> list[dict[str, Any]]:
    """Rows of a set: `fair` fair cases, the first `named` of which are named, and a case that is not fair."""
    outcomes = [("first" if i % 2 else "flag", True) if i < named else ("missed", True) for i in range(fair)]
    own = {"setting": trials.label(values), "set": name}
    return [{**own, "outcome": outcome, "fair": known} for outcome, known in (*outcomes, ("first", False))]


def case_rows(**named: tuple[int, int, int]) -> list[dict[str, Any]]:
    """Rows of sets under the present value of SAID, the smaller and the larger."""
    settings = [setting({"SAID": x}) for x in SAID.values]
    return [
        row for name, counts in named.items() for x, n in zip(settings, counts, strict=True) for row in rows(name, x, n)
    ]


def test_a_robot_takes_no_part_in_its_own_choice() -> None:
    some = case_rows(psm=(9, 2, 9), emps=(5, 6, 5), panda=(5, 6, 5))
    found = {one.robot: one for one in leave_out.leave_out(some, [SAID], ROBOTS)}
    assert found["psm"].chosen == (("SAID", LESS),) and found["emps"].chosen == ()
    assert (found["psm"].usual, found["psm"].left_out) == (Share(9, 10), Share(2, 10))
    assert found["psm"].differences == pytest.approx((70, 70)) and found["panda"].differences == (0, 0)
    every = leave_out.together(list(found.values()))
    assert (every.usual, every.left_out, every.worst) == (Share(19, 30), Share(12, 30), Share(12, 30))
    figures = leave_out.totals(list(found.values()))
    assert figures["differences in points (5)"] == "23.3, 23.3" and figures["largest of one robot"] == "70.0, 70.0"


def test_the_present_value_stays_in_a_tie() -> None:
    some = case_rows(psm=(9, 2, 3), emps=(5, 5, 5), panda=(5, 5, 5))
    assert leave_out.chosen_without(some, [SAID], "psm", ROBOTS) == ()


def test_the_worst_tie_is_decided_against_the_robot() -> None:
    some = case_rows(psm=(9, 2, 3), emps=(5, 5, 5), panda=(5, 4, 5))
    assert leave_out.chosen_without(some, [SAID], "psm", ROBOTS, worst=True) == (("SAID", MORE),)
    found = leave_out.leave_out(some, [SAID], ROBOTS)[0]
    assert (found.left_out, found.worst) == (Share(9, 10), Share(3, 10))


def test_sets_of_one_robot_leave_together() -> None:
    some = case_rows(psm=(1, 1, 1), psm_radiang=(1, 9, 1), emps=(5, 4, 5))
    assert leave_out.chosen_without(some, [SAID], "psm", ["psm", "emps"]) == ()
    assert leave_out.chosen_without(some, [SAID], "emps", ["psm", "emps"]) == (("SAID", LESS),)
    assert leave_out.figure(some, (), ["psm"]) == Share(2, 20)


def test_the_robot_that_alone_decides_is_listed() -> None:
    some = case_rows(psm=(9, 2, 9), emps=(5, 6, 5), panda=(5, 6, 5))
    (choice,) = leave_out.choices(some, [SAID], ROBOTS)
    assert choice.decided_by == {"psm": LESS} and choice.named[MORE] == Share(19, 30)
    assert [len(table.rows) for table in leave_out.tables(leave_out.leave_out(some, [SAID], ROBOTS), [choice])] == [
        4,
        1,
    ]


def test_settings_leave_out_present_values() -> None:
    assert setting({"SAID": SAID.present, "MISFIT_GROWTH": 3.0}) == (("MISFIT_GROWTH", 3.0),)
    assert leave_out.settings_of([SAID]) == [(), (("SAID", LESS),), (("SAID", MORE),)]
    assert trials.label((("MISFIT_GROWTH", 3.0), ("SAID", 0.3))) == "MISFIT_GROWTH=3, SAID=0.3"


@pytest.mark.parametrize("one", TABLE, ids=lambda one: one.name)
def test_a_constant_is_set_wherever_it_is_imported_and_restored(one: Any) -> None:
    assert one.present not in one.others and min(one.others) < one.present < max(one.others)
    before = one.present
    with applied(setting({one.name: one.others[0]})):
        held = [x.__dict__[one.name] for key, x in sys.modules.items() if key.startswith(ROOT) and one.name in vars(x)]
        assert set(held) == {one.others[0]}
    assert one.present == before
    assert all(vars(x).get(one.name, before) == before for key, x in sys.modules.items() if key.startswith(ROOT))


def test_a_constant_of_another_part_with_the_same_name_stays() -> None:
    other = import_module("signid.servo.diagnose.search")
    before = other.LEAST_GAIN
    with applied(setting({"LEAST_GAIN": 2.0})):
        assert before == other.LEAST_GAIN


class Stated:
    """Stands for a model or a dataset that states a misfit."""

    def __init__(self, misfit: float | None) -> None:
        self.misfit, self.model = misfit, self


def test_searches_are_shared_where_no_constant_that_they_read_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[float | None] = []
    monkeypatch.setattr(RUN, "select", lambda data, *_: calls.append(data.misfit) or len(calls))
    memory: dict[Any, Any] = {}
    for values in ((), setting({"SAID": LESS}), setting({"MISFIT_GROWTH": 3.0}), setting({"NOISE_ERROR": 1.0})):
        for misfit in (0.1, None):
            with shared_steps(memory, values):
                RUN.select(Stated(misfit), None, (), None)
    assert calls == [0.1, None, 0.1, 0.1, None]
    with shared_steps(memory, ()), pytest.raises(InputError):
        RUN.roll_out()


def test_rows_of_other_code_do_not_count(tmp_path: Path) -> None:
    lines = [json.dumps({"code": code, "set": "emps"}) for code in ("old", trials.digest())]
    (tmp_path / "emps.jsonl").write_text("\n".join(lines) + "\n")
    assert len(trials.load(tmp_path, ["emps", "psm"])) == 1
