"""Known changes of real robots: effect of each change; evaluation, counts and tables of rows."""

from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from rich.console import Console

import signid
from benchmarks.concealed_real import changes, sets
from benchmarks.concealed_real.cases import TILT, all_cases
from benchmarks.concealed_real.changes import Setup, columns_of, compare, ratios, ratios_apart, residual, rms
from benchmarks.concealed_real.run import Row, rows_of
from benchmarks.concealed_real.summary import line, reliability, tables, totals, worse
from signid.effects import EFFECTS
from signid.model import Model, load_model
from signid.types import Law, Recording

ROBOT = Path(__file__).parents[1] / "robots" / "3r"


@pytest.fixture(scope="module")
def model() -> Model:
    """Model of the example arm with a law of each kind at its second joint."""
    stated = load_model(ROBOT / "robot.urdf")
    sizes = {"coulomb_friction": "level", "viscous_friction": "coefficient", "armature": "inertia"}
    laws = [Law(EFFECTS[effect], (j,), {key: 0.3 + j}) for effect, key in sizes.items() for j in range(3)]
    return replace(stated, laws=(*laws, Law(EFFECTS["torque_offset"], (1,), {"offset": 0.2})))


@pytest.fixture(scope="module")
def log(model: Model) -> Recording:
    whole = signid.read_recording(ROBOT / "recording.parquet", model.robot)
    return sets.rebuilt(model.robot, columns_of(whole, 0.0, 12.0))


@pytest.fixture(scope="module")
def setup(model: Model, log: Recording) -> Setup:
    return Setup(model, log, log, 5.0, residual(model, log, 5.0))


def test_laws_are_removed_and_scaled_at_the_given_joint(model: Model) -> None:
    bare = changes.without(model, "coulomb_friction", 1)
    assert len(bare.laws) == len(model.laws) - 1
    assert not [law for law in bare.laws if law.effect.name == "coulomb_friction" and law.joints == (1,)]
    assert len(changes.without(model, "coulomb_friction").laws) == len(model.laws) - 3
    smaller = changes.scaled_law(model, "coulomb_friction", 1, 1 / 3)
    levels = [law.parameters["level"] for law in smaller.laws if law.effect.name == "coulomb_friction"]
    assert np.allclose(levels, [0.3, 1.3 / 3, 2.3])


def test_the_law_of_a_tilt_compensates_it(model: Model, log: Recording) -> None:
    leaning = changes.tilted(model, TILT, 0.0)
    law = Law(EFFECTS["base_tilt"], (0, 1, 2), {"x": -TILT, "y": 0.0})
    upright = replace(leaning, laws=(*leaning.laws, law))
    plain, back = (rms(residual(one, log, 5.0)) for one in (model, upright))
    assert np.allclose(back, plain)
    assert np.any(np.abs(rms(residual(leaning, log, 5.0)) - plain) > 1e-3 * plain)


def test_changes_affect_their_columns_only(log: Recording) -> None:
    columns = columns_of(log)
    tau = columns["tau"]
    late, early = (changes.shifted(columns, k)["tau"] for k in (3, -3))
    assert np.array_equal(late[3:], tau[:-3]) and np.array_equal(early[:-3], tau[3:])
    assert np.allclose(changes.times(columns, 1, 1.15)["tau"], tau * [1, 1.15, 1])
    assert np.array_equal(changes.swapped(columns, (0, 2))["tau"], tau[:, [2, 1, 0]])
    assert np.allclose(changes.plus(columns, 2, 0.05)["q"] - columns["q"], [0, 0, 0.05])
    assert np.array_equal(columns["tau"], columns_of(log)["tau"])


def test_the_recording_with_a_payload_matches_its_simulation(model: Model, log: Recording) -> None:
    load = changes.load_of(model)
    carried = changes.carrying(log, model, load, 5.0)
    bare = changes.carrying(log, model, None, 5.0)
    with_load = changes.with_body(model, 2, load)
    assert np.array_equal(columns_of(bare)["q"], columns_of(carried)["q"])
    plain, lacking = residual(model, bare, 5.0), residual(model, carried, 5.0)
    assert ratios(lacking, plain).max() > 0.01
    assert np.allclose(rms(residual(with_load, carried, 5.0) - plain), 0, atol=0.01 * rms(lacking - plain).max())


def test_every_change_changes_the_residual(setup: Setup) -> None:
    cases = list(all_cases(setup))
    kinds = {case.kind for case in cases}
    assert {"law removed", "law of wrong size", "payload carried", "payload gone", "link +20 %", "base tilted"} <= kinds
    assert {"torque late", "torque early", "torque gain", "encoder offset", "torque sign", "channels swapped"} <= kinds
    for case in cases:
        before = setup.residual if case.before is None else residual(setup.model, case.before, setup.cutoff)
        assert ratios(residual(case.model, case.b, setup.cutoff), before).max() > 1e-4, case.what


def test_ratios_are_of_change_to_residual() -> None:
    control = np.outer(np.sign(np.sin(1 + np.arange(100.0))), [1.0, -2.0])
    assert np.allclose(ratios(control + [0.5, 0.0], control), [0.5, 0.0])
    assert np.allclose(ratios_apart(2 * control, control), np.sqrt(3))


def test_worse_means_above_the_standard_error_of_blocks() -> None:
    rng = np.random.default_rng(0)
    given = rng.normal(size=(2000, 2))
    slightly = given * [1.0, 1.3]
    same, worse_joint = compare(given, slightly, ("a", "b"))
    assert not same.worse and worse_joint.worse and np.isclose(worse_joint.extended / worse_joint.given, 1.3)
    wild = given.copy()
    wild[:100, 0] *= 2.0  # one block alone says little
    assert not compare(given, wild, ("a", "b"))[0].worse
    assert not any(one.worse for one in compare(slightly, given, ("a", "b")))


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    """Rows of a set of simulated recordings: the control and one negated torque."""
    folder = tmp_path_factory.mktemp("data") / "arm"
    folder.mkdir()
    (folder / "robot.urdf").write_text((ROBOT / "robot.urdf").read_text())
    with gzip.open(folder / "log.csv.gz", "wb") as file:
        pl.read_parquet(ROBOT / "recording.parquet").write_csv(file)
    one = sets.RealSet("arm", "arm", "robot.urdf", *sets.thirds("log", ((0, 8), (8.1, 16), (16.1, 24))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SIGNID_DATA", str(folder.parent))
        return list(rows_of(one, ("torque sign",), None))


def test_rows_are_evaluated_counted_and_shown(rows: list[Row]) -> None:
    control, sign = rows
    assert control["kind"] == "control" and sign["kind"] == "torque sign"
    assert sign["fair"] and sign["outcome"] in ("first", "flag")
    assert len(control["unseen"]) == 3
    undone = {one["joint"]: one for one in sign["undone"]}
    assert len(undone) == 3 and not any(one["worse"] for one in undone.values())
    assert min(one["extended"] / one["given"] for one in undone.values()) < 0.1  # the torque that is negated no more
    console = Console(width=240, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(*tables(rows), *map(line, rows))
    assert "negated" in console.export_text()
    assert totals(rows)["named first or flagged (85 %)"] == "100 % (1 of 1)"
    assert sum(number for _, number, _, _ in reliability(rows)) <= 1
    assert all(row[0] == "arm" for row in worse(rows))
    json.dumps(rows)


def test_parts_of_a_real_set_are_disjoint(data: Path) -> None:
    one = sets.SETS["tx40"]
    robot = one.robot()
    spans = [sets.read(one, robot, part).read().t[[0, -1]] for part in (*one.a, one.b, one.c)]
    assert all(before[1] < after[0] for before, after in zip(spans, spans[1:], strict=False))
