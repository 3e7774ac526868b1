"""A number of a result is described once: document, terminal, page, frame and notebook follow."""

from __future__ import annotations

import re
from dataclasses import replace
from math import inf, nan
from typing import Any

import pytest
from motions import trial
from servo_results import invented
from test_output_report import shown
from test_output_report_diagnosis import made

import signid
from signid.output.report import documents, quantities, to_json
from signid.output.report.quantities import Quantity, grid, parameters
from signid.output.report.results import identification
from signid.servo.identify import ServoNumber

VALUE, STD = 4.321, 0.05
TEXT = re.compile(r"4\.321( ±\s|</td><td[^>]*>)0\.098")  # a page has a no-break space or two columns


def assert_everywhere(result: Any, frame: str) -> None:
    """The number VALUE is in all five outputs of a result."""
    page = re.sub(r"<script>.*?</script>", "", signid.report(result), flags=re.DOTALL)
    assert f'"value": {VALUE}' in to_json(documents.document(result))
    for output in (shown(documents.tables(result)), page, result._repr_html_()):
        assert TEXT.search(output), output[-3000:]
    assert (VALUE, STD) in result.to_frame(frame).select("value", "std").rows()


def test_a_number_added_to_a_drive_is_in_all_outputs() -> None:
    first, *others = invented().joints
    numbers = {**first.numbers, "resonance": ServoNumber("resonance", "N.m", VALUE, STD)}
    assert_everywhere(replace(invented(), joints=(replace(first, numbers=numbers), *others)), "drives")


@pytest.mark.parametrize(("module", "kind"), [(identification, "Identification"), (quantities, "Diagnosis")])
def test_a_number_added_to_a_law_is_in_all_outputs(module: Any, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, made_by = signid.load_robot("1r"), quantities.law_numbers
    result = made() if kind == "Diagnosis" else signid.identify(robot, [trial(robot, seconds=5.0).noisy()])

    def with_another(*given: Any) -> list[Quantity]:
        numbers = made_by(*given)
        return [*numbers, numbers[0]._replace(name="resonance", value=VALUE, std=STD, stated=None)]

    monkeypatch.setattr(module, "law_numbers", with_another)
    assert_everywhere(result, "laws")


def test_cells_say_what_is_known() -> None:
    number = Quantity("kp", VALUE, STD, "N.m/rad", "joint_1")
    cells = {
        "4.321 ± 0.098": number,
        "4.321 ± 0.098 (with prior)": number._replace(remark="with prior"),
        "4.32 (stated)": number._replace(remark="stated"),
        "(4.32)": number._replace(std=None),
        "not identifiable": number._replace(std=inf),
        "< 0.5": number._replace(value=nan, std=None, below=0.5),
        "-": number._replace(value=nan, std=None),
    }
    assert [x.cell for x in cells.values()] == list(cells)
    late = Quantity("delay", 0.01, 0.001, "s").displayed()
    assert (late.cell, late.unit) == ("10.0 ± 2.0", "ms")
    assert Quantity("share", nan, None, "1", above=0.2, more={"sentence": "why"}).document() == {
        "value": None,
        "std": None,
        "unit": "1",
        "above": 0.2,
        "sentence": "why",
    }


def test_a_grid_has_a_row_per_joint_and_units_in_its_heads() -> None:
    numbers = [Quantity("kp", 1.0, None, unit, joint) for unit, joint in (("N.m/rad", "a"), ("N/m", "b"))]
    heads, rows = grid([*numbers, Quantity("share", 0.5, None, "", "b")], lambda x: f"{x.name}\n", "abc")
    assert heads == ["kp\n[N.m/rad or N/m]>", "share>"]
    assert rows == [["(1.00)", ""], ["(1.00)", "(0.500)"], ["", ""]]
    pair = Quantity("inertia", 0.1, None, "kg.m2", "a", partner="b")
    assert list(parameters([pair])) == ["partner", "inertia"] and parameters([]) == {}
