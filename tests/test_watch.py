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


def found(model: Model, columns: Mapping[str, Any], **changed: Any) -> list[Event]:
    given = {**columns, **changed}
    watcher = Watcher(model, quiet=QUIET)
    events: list[Event] = []
    for start in range(0, len(given["t"]), 8):
        rows = slice(start, start + 8)
        events += watcher.feed(given["t"][rows], given["q"][rows], given["tau"][rows])
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
    assert ended.force is not None and np.linalg.norm(ended.force) == pytest.approx(1)


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
        for e in found(model, columns, tau=columns["tau"] + np.where(columns["t"] > 14, 1.0, 0.0)[:, None] * more)
        if isinstance(e, LastingChange)
    ]
    assert [e.law for e in changes] == ["payload"]
    assert changes[0].parameters["mass"] == pytest.approx(0.4, rel=0.1) and "kg" in changes[0].sentence


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


def test_a_recording_is_played_back(model: Model, columns: dict[str, Any]) -> None:
    arrays = {"t": columns["t"], "q": columns["q"], "tau": pushed(columns)}
    assert sum(isinstance(e, Contact) for e in signid.watch(model, arrays, quiet=QUIET)) == 2


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


def test_a_watch_is_lean(model: Model, columns: dict[str, Any]) -> None:
    begin = time.process_time()
    found(model, columns)
    assert time.process_time() - begin < 0.25 * DURATION  # half of it is measured, on a busy machine


def test_the_live_view_shows_joints_and_events(model: Model, columns: dict[str, Any]) -> None:
    from collections import deque

    from rich.console import Console

    from signid.cli.commands.watching import _sentence, _table

    watcher = Watcher(model, quiet=QUIET)
    events = watcher.feed(columns["t"], columns["q"], pushed(columns))
    screen = Console(width=100, record=True, file=open(os.devnull, "w"))
    screen.print(_table(watcher, deque(map(_sentence, events))))
    shown = screen.export_text()
    assert "3r at 24.00 s" in shown and "joint_3" in shown and "contact at link_3" in shown


def test_a_slow_stream_and_huge_numbers_are_noted(model: Model, columns: dict[str, Any]) -> None:
    tau = columns["tau"].copy()
    tau[100] = 1e300
    slow = Watcher(model).feed(columns["t"][:40] * 100, columns["q"][:40], columns["tau"][:40])
    huge = Watcher(model).feed(columns["t"][:200], columns["q"][:200], tau[:200])
    assert any(isinstance(e, Note) and "too slowly" in e.sentence for e in slow)
    assert [isinstance(e, Note) and "without a number" in e.sentence for e in huge] == [True]
