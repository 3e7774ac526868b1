"""A robot is watched: contacts, changes, faults of the stream, sources."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signid
from signid.cli.run import run
from signid.errors import OptionError, RecordingError
from signid.model import Model
from signid.regression.motion import Motion
from signid.simulation.excite.families import rest_to_rest_motion
from signid.watch import Contact, Event, LastingChange, Note, Watcher

RATE, DURATION, QUIET = 500.0, 24.0, 8.0
FRICTION = ((0.5, 0.8), (0.4, 0.6), (0.2, 0.3))  # viscous [N.m.s/rad] and Coulomb [N.m] per joint


@pytest.fixture(scope="module")
def model() -> Model:
    from signid.effects.naming import parse_law

    stated = signid.load_model("3r")
    texts = [
        f"{effect}@{j + 1}:{key}={values[k]}"
        for j, values in enumerate(FRICTION)
        for k, (effect, key) in enumerate((("viscous_friction", "coefficient"), ("coulomb_friction", "level")))
    ]
    return Model(stated.robot, stated.inertials, tuple(parse_law(text, stated.robot) for text in texts))


@pytest.fixture(scope="module")
def columns(model: Model) -> dict[str, Any]:
    """Quiet stream of a random motion: t, q and tau, with torque noise."""
    asked = rest_to_rest_motion(model.robot, DURATION, 1 / RATE, 4)
    motion = Motion(model.robot, asked.t, asked.q, asked.v, asked.a)
    noise = 0.02 * np.random.default_rng(1).standard_normal(asked.q.shape)
    return {"t": asked.t, "q": asked.q, "tau": model.inverse(motion) + noise, "v": asked.v, "motion": motion}


def found(model: Model, columns: Mapping[str, Any], rows: int = 64, **changed: Any) -> list[Event]:
    """Events of a stream that arrives in pieces of some rows."""
    given = {**columns, **changed}
    watcher = Watcher(model, quiet=QUIET)
    events: list[Event] = []
    for start in range(0, len(given["t"]), rows):
        piece = slice(start, start + rows)
        events += watcher.feed(given["t"][piece], given["q"][piece], given["tau"][piece])
    return [*events, *watcher.finish()]


def pushed(columns: Mapping[str, Any], start: float = 16.0, end: float = 16.4) -> Any:
    t = columns["t"]
    return columns["tau"] + np.where((t > start) & (t < end), 1.0, 0.0)[:, None] * np.array([0.5, 1.5, 1.0])


def test_a_quiet_stream_has_no_alarm(model: Model, columns: dict[str, Any]) -> None:
    events = found(model, columns)
    assert [type(event) for event in events] == [Note] and "thresholds" in events[0].document()["sentence"]


def test_a_push_is_a_contact(model: Model, columns: dict[str, Any]) -> None:
    begun, ended = [e for e in found(model, columns, tau=pushed(columns)) if isinstance(e, Contact)]
    assert 0 < begun.t - 16 < 0.05 and begun.end is None and "joint_2" in begun.joints
    assert abs(ended.start - 16) < 0.03 and ended.end is not None and abs(ended.end - 16.4) < 0.1
    assert ended.link == "link_3" and ended.torque["joint_2"] == pytest.approx(1.5, rel=0.2)
    assert ended.direction is not None and np.linalg.norm(ended.direction) == pytest.approx(1)


def test_rows_that_come_one_by_one_give_the_same_contact(model: Model, columns: dict[str, Any]) -> None:
    contacts = []
    for size in (50, 1):
        watcher, rows = Watcher(model, quiet=QUIET), (columns["t"], columns["q"], pushed(columns))
        watcher.feed(*(x[:7500] for x in rows))
        fed = [watcher.feed(*(x[k : k + size] for x in rows)) for k in range(7500, 8700, size)]
        contacts.append([e for events in fed for e in events if isinstance(e, Contact)])
    assert [len(one) for one in contacts] == [2, 2]
    for a, b in zip(*contacts, strict=True):
        assert abs(a.start - b.start) < 0.01 and a.joints == b.joints
        assert a.end == b.end or abs((a.end or 0.0) - (b.end or 0.0)) < 0.02


@pytest.mark.slow_cases("torque_gain|torque_offset")
@pytest.mark.parametrize(
    ("law", "key", "joint", "number"),
    [
        ("viscous_friction", "coefficient", 1, 0.4),
        ("coulomb_friction", "level", 0, 0.4),
        ("torque_offset", "offset", 2, 0.3),
        ("torque_gain", "error", 1, 0.1),
    ],
)
def test_a_change_is_named(
    law: str, key: str, joint: int, number: float, model: Model, columns: dict[str, Any]
) -> None:
    v, tau = columns["v"][:, joint], columns["tau"].copy()
    added = {"viscous_friction": v, "coulomb_friction": np.sign(v), "torque_offset": 1.0, "torque_gain": tau[:, joint]}
    tau[:, joint] += np.where(columns["t"] > 14, number * added[law], 0.0)
    changes = [e for e in found(model, columns, tau=tau) if isinstance(e, LastingChange)]
    assert [(e.law, e.joint) for e in changes[:1]] == [(law, model.robot.joints[joint])]
    assert changes[0].probability > 0.95 and 0 < changes[0].t - 14 < 10
    assert changes[-1].parameters[key] == pytest.approx(number, rel=0.15)


def test_a_payload_is_named(model: Model, columns: dict[str, Any]) -> None:
    from signid.effects.naming import parse_law

    load = parse_law("payload:mass=0.4,first_moment_x=0.04,first_moment_y=0,first_moment_z=0", model.robot)
    loaded = Model(model.robot, model.inertials, (*model.laws, load)).inverse(columns["motion"])
    more = loaded - model.inverse(columns["motion"])
    changes = [
        e
        for e in found(model, columns, 8, tau=columns["tau"] + np.where(columns["t"] > 14, 1.0, 0.0)[:, None] * more)
        if isinstance(e, LastingChange)
    ]
    assert [e.law for e in changes] == ["payload"] * 2
    assert changes[0].parameters["mass"] == pytest.approx(0.4, rel=0.1) and "kg" in changes[0].sentence
    assert changes[1].corrects == changes[0].t and changes[1].parameters["mass"] == pytest.approx(0.4, rel=0.02)
    assert changes[1].std["mass"] < changes[0].std["mass"]


def test_faults_of_the_stream_are_noted(model: Model, columns: dict[str, Any]) -> None:
    t, q, tau = (columns[key].copy() for key in ("t", "q", "tau"))
    tau[6000] = np.nan
    t[7000] = t[6999]
    t[8000:] += 1.0
    t[9000:] -= 3.0
    q[10000:] += 2.0
    events = found(model, columns, t=t, q=q, tau=tau)
    sentences = [e.sentence for e in events if isinstance(e, Note)]
    for part in ("without a number", "repeated", "stopped for 1", "jump back by 3", "joint_1 jumps"):
        assert sum(part in sentence for sentence in sentences) == 1, sentences
    assert len(sentences) == 6


def text(columns: Mapping[str, Any], kind: str, tau: Any = None) -> str:
    tau = columns["tau"] if tau is None else tau
    rows = zip(columns["t"].tolist(), columns["q"].tolist(), tau.tolist(), strict=True)
    if kind == "json":
        return "".join(json.dumps({"t": t, "q": q, "tau": x}) + "\n" for t, q, x in rows)
    header = ",".join(["t", *(f"{key}_{j}" for key in ("q", "tau") for j in (1, 2, 3))])
    return "\n".join([header, *(",".join(f"{x:.9g}" for x in (t, *q, *x)) for t, q, x in rows), ""])


@pytest.mark.parametrize("kind", ["csv", "json"])
def test_texts_are_streams(kind: str, model: Model, columns: dict[str, Any]) -> None:
    whole = text(columns, kind, pushed(columns))
    parts = [whole[k : k + 5000] for k in range(0, len(whole), 5000)]
    events = list(signid.watch(model, iter(parts), quiet=QUIET))
    assert [type(e) for e in events] == [Note, Contact, Contact]


@pytest.mark.slow
def test_a_growing_file_is_followed(model: Model, columns: dict[str, Any], tmp_path: Path) -> None:
    lines = text(columns, "csv", pushed(columns)).splitlines(keepends=True)
    path = tmp_path / "stream.csv"
    path.write_text("".join(lines[:100]) + lines[100][:7])

    def grow() -> None:
        with path.open("a") as file:
            file.write(lines[100][7:])
            for start in range(101, len(lines), 3000):
                file.writelines(lines[start : start + 3000])
                file.flush()
                time.sleep(0.03)

    thread = threading.Thread(target=grow)
    thread.start()
    events = list(signid.watch(model, path, quiet=QUIET, follow=True, idle=3.0))
    thread.join()
    assert [type(e) for e in events] == [Note, Contact, Contact]


def test_standard_input_and_lines_of_json(model: Model, columns: dict[str, Any], tmp_path: Path) -> None:
    saved = model.save(tmp_path / "model.json")
    command = [sys.executable, "-m", "signid", "watch", str(saved), "-", "--json", "--quiet", str(QUIET)]
    done = subprocess.run(
        command, input=text(columns, "csv", pushed(columns)), capture_output=True, text=True, env={**os.environ}
    )
    assert done.returncode == 0 and not done.stderr
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert [e["event"] for e in events] == ["note", "contact", "contact"]
    assert {e["schema"] for e in events} == {"signid.watch/1"} and events[1]["end"] is None


def test_bad_input_is_one_sentence(model: Model, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RecordingError, match="no torque of a joint"):
        list(signid.watch(model, iter(["t,q_1,q_2,q_3\n0,1,2,3\n"])))
    with pytest.raises(RecordingError, match="give a header"):
        list(signid.watch(model, iter(["hello\n"])))
    with pytest.raises(RecordingError, match="no rows"):
        list(signid.watch(model, iter([""])))
    with pytest.raises(OptionError, match="quiet is -1"):
        list(signid.watch(model, {}, quiet=-1))
    for arguments in (["ros:/joint_states"], [str(tmp_path / "none.csv"), "--follow"], ["-", "--idle", "-1"]):
        assert run(["watch", "3r", *arguments]) == 2
        out, err = capfd.readouterr()
        assert not out and err.startswith("signid: ") and err.count("\n") == 1, err


def test_a_slow_stream_and_huge_numbers_are_noted(model: Model, columns: dict[str, Any]) -> None:
    tau = columns["tau"].copy()
    tau[100] = 1e300
    slow = Watcher(model).feed(columns["t"][:40] * 100, columns["q"][:40], columns["tau"][:40])
    huge = Watcher(model).feed(columns["t"][:200], columns["q"][:200], tau[:200])
    assert any(isinstance(e, Note) and "too slowly" in e.sentence for e in slow)
    assert [isinstance(e, Note) and "without a number" in e.sentence for e in huge] == [True]


def lost(columns: Mapping[str, Any], kind: str) -> dict[str, Any]:
    """Stream with packets lost, held, in bursts, or with stamps that jitter."""
    rng = np.random.default_rng(3)
    t, q, tau = (columns[key].copy() for key in ("t", "q", "tau"))
    keep, gap = np.ones(len(t), bool), np.zeros(len(t), bool)
    for begin in np.arange(2.0, DURATION - 1, 1.3):
        gap |= (t > begin) & (t < begin + rng.uniform(0.01, 0.2))
    if kind == "lost":
        keep = (rng.random(len(t)) > 0.02) & ~gap
    elif kind == "missing":
        tau[rng.random(len(t)) < 0.01, 1] = np.nan
    elif kind == "held":
        held = np.maximum.accumulate(np.where(gap, 0, np.arange(len(t))))
        q, tau = q[held], tau[held]
    elif kind == "bursts":
        last = np.minimum(np.arange(len(t)) // 4 * 4 + 3, len(t) - 1)
        t = t[last] + 5e-5 * (np.arange(len(t)) % 4)
    else:
        t = t + rng.uniform(-0.4, 0.4, len(t)) / RATE
    return {**columns, "t": t[keep], "q": q[keep], "tau": tau[keep]}


@pytest.mark.slow_cases(but="missing")
@pytest.mark.parametrize("kind", ["lost", "missing", "held", "bursts", "jitter"])
def test_a_damaged_stream_has_no_false_contact(kind: str, model: Model, columns: dict[str, Any]) -> None:
    events = found(model, lost({**columns, "tau": pushed(columns)}, kind))
    hit = [e for e in events if isinstance(e, Contact)]
    assert any(e.end is None for e in hit) and all(abs(e.start - 16) < 0.1 for e in hit), "the push, and no other"
    assert not [e for e in events if isinstance(e, LastingChange)]


def test_a_joint_that_did_not_move_is_noted_and_has_no_false_contact(model: Model) -> None:
    asked = rest_to_rest_motion(model.robot, DURATION, 1 / RATE, 4)
    still = asked.t < 14
    q, v, a = asked.q.copy(), asked.v.copy(), asked.a.copy()
    k = int(np.flatnonzero(~still & (np.abs(v[:, 1]) < 1e-6))[0])
    q[:k, 1], v[:k, 1], a[:k, 1] = q[k, 1], 0.0, 0.0
    noise = 0.02 * np.random.default_rng(1).standard_normal(q.shape)
    tau = 1.03 * model.inverse(Motion(model.robot, asked.t, q, v, a)) + noise
    events = found(model, {"t": asked.t, "q": q, "tau": tau})
    assert "joint_2 did not move" in events[0].document()["sentence"]
    assert not [e for e in events if isinstance(e, Contact)]


def test_a_stop_that_swings_is_no_contact(model: Model, columns: dict[str, Any]) -> None:
    late = np.stack([np.interp(columns["t"] - 0.004, columns["t"], x) for x in columns["tau"].T], axis=1)
    smooth = columns["t"] < 12  # the quiet stretch shows less of it than the rest
    tau = np.where(smooth[:, None], columns["tau"], late)
    assert not [e for e in found(model, columns, tau=tau) if isinstance(e, Contact)]


def test_sensitivity_scales_thresholds(model: Model, columns: dict[str, Any]) -> None:
    usual, twice = Watcher(model, quiet=QUIET), Watcher(model, quiet=QUIET, sensitivity=2.0)
    for watcher in (usual, twice):
        watcher.feed(columns["t"], columns["q"], columns["tau"])
    assert np.allclose(usual.threshold, 2 * twice.threshold)
    with pytest.raises(OptionError, match="sensitivity is 0"):
        Watcher(model, sensitivity=0.0)


def test_a_load_corrects_the_contact_it_looked_like_and_is_saved(
    model: Model, columns: dict[str, Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    from signid.effects.naming import parse_law

    load = parse_law("payload:mass=0.8,first_moment_x=0.08,first_moment_y=0,first_moment_z=0", model.robot)
    loaded = Model(model.robot, model.inertials, (*model.laws, load)).inverse(columns["motion"])
    tau = columns["tau"] + np.where(columns["t"] > 13, 1.0, 0.0)[:, None] * (loaded - model.inverse(columns["motion"]))
    (tmp_path / "stream.csv").write_text(text(columns, "csv", tau))
    saved = model.save(tmp_path / "model.json")
    asked = ["watch", str(saved), str(tmp_path / "stream.csv"), "--quiet", str(QUIET)]
    assert run([*asked, "--save", str(tmp_path / "loaded.json")]) == 0
    out, err = capfd.readouterr()
    lines = [json.loads(line) for line in out.splitlines()]
    contacts = [one for one in lines if one["event"] == "contact" and one["end"] is not None]
    causes = {one["corrects"] if one["corrects"] is not None else one["t"]: one["cause"] for one in contacts}
    assert causes and all("payload" in cause for cause in causes.values())
    carried = signid.load_model(tmp_path / "loaded.json").laws[-1]
    assert carried.parameters["mass"] == pytest.approx(0.8, rel=0.03) and "loaded.json" in err
    for bad in (saved, saved / "x.json", tmp_path / "x.txt"):
        assert run([*asked, "--save", str(bad)]) == 2 and capfd.readouterr().err.count("\n") == 1


def test_the_live_view_shows_joints_and_events(model: Model, columns: dict[str, Any]) -> None:
    from rich.console import Console

    from signid.cli.commands.watching import _table, sentence

    watcher = Watcher(model, quiet=QUIET)
    events = watcher.feed(columns["t"], columns["q"], pushed(columns))
    screen = Console(width=100, record=True, file=open(os.devnull, "w"))
    for event in events:
        screen.print(sentence(event, model.robot))
    screen.print(_table(watcher))
    shown = screen.export_text()
    assert "3r at 24.00 s" in shown and "joint_3" in shown and " contact at link_3: " in shown
    assert "end of the contact of 15.99" in shown or "end of the contact of 16.0" in shown
