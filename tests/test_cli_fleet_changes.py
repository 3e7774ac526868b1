"""A change between sessions and an outlier between robots are findings with a probability; repeats stay silent."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import Chromium
from fleets import manifest, record
from test_cli_fleet_summary import diagnosis
from test_output_report import shown

from signid.cli.fleet import run as run_module
from signid.cli.fleet.manifest import Entry
from signid.cli.fleet.result import Difference, Number, Outcome, Summary, find_changes, find_outliers, summarise
from signid.cli.fleet.run import DONE, Answer, Order, fleet
from signid.output.report.results.fleet import fleet_page, fleet_tables

JOINTS = ("j1", "j2", "j3")
STD = 0.01  # of noise alone [N.m]


def outcome(name: str, robot: str, summary: Summary) -> Outcome:
    """A session of a robot with its result."""
    return Outcome(Entry(1, name, robot, "r", "identify", ()), 0, (), (), summary)


def session(name: str, robot: str, rng: np.random.Generator, spread: float, **levels: float) -> Outcome:
    """Identified friction of three joints around 0.8 and ten base parameters around 2."""
    numbers = [
        Number(f"coulomb_friction of {joint}: level", "N.m", value, STD, "coulomb_friction", joint)
        for joint in JOINTS
        for value in [levels.get(joint, 0.8) * np.exp(spread * rng.standard_normal()) + STD * rng.standard_normal()]
    ]
    numbers += [Number(f"Izz_{k}", "kg.m^2", 2 + STD * rng.standard_normal(), STD) for k in range(10)]
    return outcome(name, robot, Summary("r", numbers=tuple(numbers)))


def found(changes: Sequence[Difference]) -> list[tuple[str, str, str | None]]:
    return [(one.at.entry.name, one.at.entry.session, one.number.joint) for one in changes if one.found]


def test_repeated_sessions_stay_silent_and_a_change_is_found() -> None:
    rng, alarms, hits, smaller = np.random.default_rng(0), 0, 0, 0
    for _ in range(200):
        first, again = (session(name, "arm", rng, 0.06) for name in ("first", "again"))
        alarms += len(found(find_changes([[first, again]])))
        hits += ("arm", "worn", "j2") in found(find_changes([[first, session("worn", "arm", rng, 0.06, j2=1.3)]]))
        smaller += bool(found(find_changes([[first, session("worn", "arm", rng, 0.06, j2=0.9)]])))
    assert alarms <= 2 and hits >= 170 and smaller <= 10


def test_scatter_of_most_parameters_widens_their_standard_deviations() -> None:
    rng, alarms = np.random.default_rng(1), 0
    for _ in range(100):
        pair = [session(name, "arm", rng, 0.0) for name in ("first", "again")]
        wide = [one._replace(value=one.value + 10 * STD * rng.standard_normal()) for one in pair[1].summary.numbers]
        numbers = tuple(one._replace(std=STD / 10) for one in wide)
        alarms += len(found(find_changes([[pair[0], pair[1]._replace(summary=Summary("r", numbers=numbers))]])))
    assert alarms <= 2


def test_a_change_is_found_once_and_more_sessions_find_smaller_ones() -> None:
    rng = np.random.default_rng(2)
    before = [session(f"{k}", "arm", rng, 0.02) for k in range(6)]
    worn = [session(f"worn {k}", "arm", rng, 0.02, j2=1.3) for k in range(4)]
    changes = find_changes([[*before, *worn]])
    assert found(changes) == [("arm", "worn 0", "j2")] and len(changes) == 9 * 13
    assert changes[0].probability > 0.999 and [one.entry.session for one in changes[0].others] == list("012345")
    assert changes[0].centre == pytest.approx(0.8, abs=0.05) and changes[0].number.value == pytest.approx(1.3, abs=0.1)
    small = session("small", "arm", rng, 0.0, j2=1.15)
    alone, many = find_changes([[before[0], small]]), find_changes([[*before, small]])
    assert many[0].odds > max(0.0, alone[0].odds)


def test_an_outlier_is_the_robot_that_differs_from_the_others_of_its_kind() -> None:
    rng, alarms, hits = np.random.default_rng(3), 0, 0
    for _ in range(50):
        robots = [session("last", f"arm {k}", rng, 0.15) for k in range(6)]
        alarms += len(found(find_outliers([robots])))
        worn = session("last", "worn", rng, 0.0, j2=2.0)
        hits += found(find_outliers([[*robots, worn]]))[:1] == [("worn", "last", "j2")]
    assert alarms <= 3 and hits >= 40
    assert find_outliers([robots[:2]]) == [], "of two robots that differ, neither is the outlier"


def test_a_law_that_one_diagnosis_does_not_name_is_zero_there() -> None:
    def pair(share: float, **other: float) -> list[Outcome]:
        documents = [diagnosis(other, 0.1), diagnosis({"coulomb_friction": 0.8}, 1.0)]
        documents[1]["findings"][0]["torque_share"] = {"j2": share}
        for document in documents:
            document["tolerance"] = 0.01
        summaries = [summarise("diagnose", document) for document in documents]
        return [outcome(name, "arm", one) for name, one in zip(("a", "b"), summaries, strict=True)]

    changes = find_changes([pair(0.3)])
    assert found(changes) == [("arm", "b", "j2")] and changes[0].centre == 0
    assert found(find_changes([pair(0.012)])) == [], "a law hardly above the tolerance may have been there before"
    assert find_changes([pair(0.3, stribeck_friction=0.7)]) == [], "another law of the joint may be the same physics"


@pytest.mark.slow
def test_findings_stand_in_the_file_on_the_terminal_and_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(tmp_path, 1)
    levels = [0.8, 0.8, 0.8, 0.8, 0.8, 2.4]

    def answer(orders: Sequence[Order], *_: object) -> Iterator[tuple[int, Answer]]:
        for k in range(len(orders)):
            document = diagnosis({"coulomb_friction": levels[k]}, 1.0)
            yield k, Answer(DONE, (), {"diagnosis.json": json.dumps(document).encode()})

    monkeypatch.setattr(run_module, "spread", answer)
    rows = [f"3r,day_0.parquet,arm {k // 2},2026-0{1 + k % 2}-01,diagnose" for k in range(6)]
    document: dict[str, Any] = fleet(manifest(tmp_path, *rows), tmp_path / "out").document()
    (change,), (outlier,) = document["changes"], document["outliers"]
    said = "arm 2: Coulomb friction of j2 changed from 0.80 ± 0.02 N.m (2026-01-01) to 2.40 ± 0.02 N.m (2026-02-01)"
    assert change["sentence"].startswith(f"{said}; +200 %, probability >0.99") and change["finding"]
    assert (change["after"]["value"], change["before"]["value"], change["unit"]) == (2.4, 0.8, "N.m")
    assert outlier["name"] == "arm 2" and "0.800 N.m in the other 2 robots (0.800)" in outlier["sentence"]
    assert document["comparison"]["prior"] == 0.01 and document["comparison"]["changes_tested"] == 3
    text = " ".join(shown(fleet_tables(document), 200).split())
    headline = "arm 2: Coulomb friction of j2 changed from 0.80 ± 0.02 N.m to 2.40 ± 0.02 N.m (0.800 N.m in the other 2"
    assert text.startswith(headline) and text.index(said) < text.index("Robots by mismatch")
    assert "1 robot changed between sessions, 1 robot is an outlier" in text
    (tmp_path / "index.html").write_text(fleet_page(document), encoding="utf-8")
    browser = Chromium(tmp_path / "browser", 390, 900)
    try:
        size = {"width": 390, "height": 900, "deviceScaleFactor": 1, "mobile": True}
        browser.send("Emulation.setDeviceMetricsOverride", **size)
        browser.open((tmp_path / "index.html").as_uri(), "document.querySelectorAll('h2').length > 3")
        assert said in browser.value("document.body.innerText.replace(/\\s+/g, ' ')")
        inside = "[...document.querySelectorAll('td')].filter(x => x.getBoundingClientRect().right > innerWidth).length"
        assert browser.value(inside) == 0 and browser.value("document.documentElement.scrollWidth") <= 390
    finally:
        browser.close()
