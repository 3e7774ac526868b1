"""Logs as strangers write them, each of one kind that once stopped the first command; their values are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import signid

ROBOT = signid.load_robot("3r")
T = np.arange(0, 6, 0.01)
Q = np.sin(np.outer(T, [1.3, 2.1, 2.9]))
TAU = 5 * np.cos(np.outer(T, [1.3, 2.1, 2.9]))


def table(separator: str, decimal: str, header: list[str], columns: list[list[str]], above: str = "") -> str:
    """Text of a table: the header, rows of cells with a decimal mark, and lines above."""
    rows = [separator.join(cell.replace(".", decimal) for cell in row) for row in zip(*columns, strict=True)]
    return above + "\n".join([separator.join(header), *rows]) + "\n"


def cells(values: np.ndarray, form: str = "%.7f", missing: str = "") -> list[str]:
    """Cells of a column, of which one is missing where a text for it is given."""
    found = [form % value for value in values]
    return [missing if missing and k == 300 else cell for k, cell in enumerate(found)]


def numbered(name: str) -> list[str]:
    return [name.format(j) for j in (1, 2, 3)]


def kuka() -> str:
    names = ["Zeitstempel", *numbered("$AXIS_ACT.A{}"), *numbered("$TORQUE_AXIS_ACT[{}]")]
    units = ["[ms]", "[\u00b0]", "[\u00b0]", "[\u00b0]", "[Nm]", "[Nm]", "[Nm]"]
    columns = [cells(1.7e12 + 1e3 * T, "%.0f"), *map(cells, np.degrees(Q).T), *(cells(x, missing="-") for x in TAU.T)]
    columns = [[unit, *column] for unit, column in zip(units, columns, strict=True)]
    return table(";", ",", names, columns, "\ufeffTrace;8.6\n\n")


def german() -> str:
    names = ["Datum", "Uhrzeit", *numbered("Achse {} Istposition in Grad"), *numbered("Achse {} Drehmoment in Nm")]
    day = [f"10:00:{t // 1:02.0f}.{1e3 * (t % 1):03.0f}" for t in np.round(T, 2)]
    return table(";", ",", names, [["3.5.2024"] * len(T), day, *map(cells, np.degrees(Q).T), *map(cells, TAU.T)])


def ros() -> str:
    names = ["header.stamp.sec", "header.stamp.nanosec"]
    names += [f"{kind}_{j}" for kind in ("name", "position", "effort") for j in range(3)]
    order = [2, 0, 1]  # not that of the robot
    columns = [cells(1.7e9 + T // 1, "%.0f"), cells(1e9 * np.round(T % 1, 2), "%.0f")]
    columns += [[ROBOT.joints[j]] * len(T) for j in order] + [cells(x[:, j]) for x in (Q, TAU) for j in order]
    return table(",", ".", names, columns)


def italian() -> str:
    names = ["tempo (us)", *numbered("posizione giunto {} (deg)"), *numbered("coppia giunto {} (Nm)")]
    columns = [cells(1e6 * T, "%.0f"), *map(cells, np.degrees(Q).T), *(cells(x, missing="n/a") for x in TAU.T)]
    return table("\t", ",", names, columns)


def spanish() -> str:
    names = ["Tiempo [s]", *numbered("Posici\u00f3n eje {} [\u00b0]"), *numbered("Par eje {} [Nm]")]
    return table(
        ";", ",", names, [cells(np.floor(T * 20) / 20, "%.2f"), *map(cells, np.degrees(Q).T), *map(cells, TAU.T)]
    )


@pytest.mark.parametrize("made", [kuka, german, ros, italian, spanish])
def test_the_first_command_reads_it(made: object, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(made())  # type: ignore[operator]
    found = signid.read_recording(tmp_path / "log.csv", ROBOT)
    assert found.joints == ROBOT.joints and found.reading and len(found.reading.rows) == 4
    samples = found.read()
    np.testing.assert_allclose(samples.t - samples.t[0], T, atol=1e-3)
    np.testing.assert_allclose(samples.q, Q, atol=1e-6)
    np.testing.assert_allclose(samples.tau, TAU, atol=1e-3)  # a missing value is bridged


def test_a_gripper_without_torque_does_not_stop_the_arm() -> None:
    columns = {"t": T, **{f"{kind}_{j + 1}": x[:, j] for kind, x in (("q", Q), ("tau", TAU)) for j in range(3)}}
    still = {"q_3": np.full(len(T), 0.02), "tau_3": np.zeros(len(T))}
    found = signid.read_recording(columns | still, ROBOT)
    assert found.columns["tau"] == ("tau_1", "tau_2", "") and any("zero throughout" in note for note in found.notes)
    assert signid.read_recording(columns | {"tau_3": still["tau_3"]}, ROBOT).columns["tau"][2] == "tau_3", "it moves"
