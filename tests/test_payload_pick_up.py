"""The load of the last link from one recording in which it is picked up: MuJoCo, and recordings of a UR10e."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from picked_up import OTHER, OTHERS, SCALE, arm, recorded, spliced

from benchmarks.real_data import LOADED, UNLOADED, ur10e
from benchmarks.watch.plant import Alteration, Push
from signid.cli import run
from signid.errors import OptionError
from signid.payload import Payload, payload

SAME, OTHER_DAY = UNLOADED


def weighed(*events: Alteration | Push, seed: int = 0) -> Payload:
    return payload(arm(), recorded(events, seed))


@pytest.mark.slow_cases("18|9.0")
@pytest.mark.parametrize(("when", "mass", "seed"), [(12.3, 1.2, 0), (18.0, 0.3, 1), (9.0, 3.0, 2)])
def test_a_load_is_found_with_its_moment(when: float, mass: float, seed: int) -> None:
    found = weighed(Alteration(when, "payload", 5, mass), seed=seed)
    [moment] = found.moments
    assert found.found and moment.picked_up and not found.flags
    assert abs(moment.t - when) < 3 * moment.std < 1.0
    value, std = found.mass
    assert abs(value - mass) < 4 * std and abs(value / mass - 1) < 0.03


@pytest.mark.slow_cases(but="events0")
@pytest.mark.parametrize("events", [(), *((event,) for event in OTHERS)])
def test_no_load_is_invented(events: tuple[Alteration | Push, ...]) -> None:
    found = weighed(*events, seed=4)
    assert not found.found and not found.moments and np.isnan(found.mass[0])
    assert found.flags[0].startswith("no load picked up: ")
    with pytest.raises(OptionError, match="no load was found"):
        _ = found.law
    assert "No load was found" in str(found) and found.to_frame("payload").is_empty()


@pytest.mark.slow
def test_commands_print_moments_or_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(arm().document)
    for name, events in (("bare", ()), ("lifted", (Alteration(12.3, "payload", 5, 1.2),))):
        pl.DataFrame(recorded(events, 0)).write_csv(tmp_path / f"{name}.csv")
    assert run(["payload", str(urdf), str(tmp_path / "lifted.csv")]) == 0
    assert "picked up at" in capsys.readouterr().out
    assert run(["payload", str(urdf), str(tmp_path / "lifted.csv"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["found"] and abs(document["moments"][0]["t"] - 12.3) < 0.5 and document["mass"]["value"] > 1
    assert run(["payload", str(urdf), str(tmp_path / "bare.csv")]) == 3
    shown = capsys.readouterr()
    assert "no load picked up" in shown.err and "kg" not in shown.out
    assert run(["payload", str(urdf), str(tmp_path / "bare.csv"), "--json"]) == 3
    document = json.loads(capsys.readouterr().out)
    assert not document["found"] and document["moments"] == [] and "mass" not in document and document["effect"] is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "no recording was given"),
        (["x.csv", "--with", "y.csv"], "neither --without nor --with"),
        (["--with", "y.csv"], "without the load was given"),
        (["x.csv", "y.csv"], "sought in one recording, not in 2"),
    ],
)
def test_bad_input_ends_with_a_sentence(
    given: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for k, name in enumerate(("x.csv", "y.csv")):
        assert run(["simulate", "3r", "--duration", "3", "--seed", str(k), "-o", name]) == 0
    capsys.readouterr()
    assert run(["payload", "3r", *given]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_desired_positions_do_not_matter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Recordings with q_des, whose covariance by instruments has negative eigenvalues here."""
    tables = []
    for name, laws in (("bare", []), ("loaded", ["--inject", "payload:mass=0.4"])):
        path = tmp_path / f"{name}.csv"
        seed = "3" if laws else "2"
        assert run(["simulate", "3r", *"--duration 12 --noise 0.02 --seed".split(), seed, *laws, "-o", str(path)]) == 0
        tables.append(pl.read_csv(path))
    end = float(tables[0]["t"][-1])
    whole = pl.concat([tables[0], tables[1].with_columns(t=pl.col("t") + end + 0.3)])
    found = payload("3r", whole)
    [moment] = found.moments
    assert abs(moment.t - end - 0.15) < 3 * moment.std
    mass, std = found.mass
    assert abs(mass - 0.4) < 3 * std < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("order", [(OTHER, LOADED), (LOADED, OTHER_DAY)])
def test_a_load_on_a_real_robot(order: tuple[str, ...], data: Path) -> None:
    folder = data / "ur10e_mamedov"
    samples, [between] = spliced(folder, *order)
    found = payload(ur10e(), samples)
    [moment] = found.moments
    assert moment.picked_up == (order[-1] == LOADED)
    assert abs(moment.t - between) < 3 * moment.std < 9
    mass, std = found.mass
    assert abs(mass - SCALE) < 3 * std and abs(mass / SCALE - 1) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("order", [(OTHER_DAY,), (SAME, OTHER), (LOADED,)])
def test_a_real_robot_without_a_change_has_none(order: tuple[str, ...], data: Path) -> None:
    folder = data / "ur10e_mamedov"
    found = payload(ur10e(), spliced(folder, *order)[0])
    assert not found.found and "no load picked up" in found.flags[0]


def test_a_load_is_picked_up_and_put_down(data: Path) -> None:
    folder = data / "ur10e_mamedov"
    samples, times = spliced(folder, SAME, LOADED, OTHER)
    found = payload(ur10e(), samples)
    assert [moment.picked_up for moment in found.moments] == [True, False]
    assert all(abs(moment.t - t) < 3 * moment.std for moment, t in zip(found.moments, times, strict=True))
