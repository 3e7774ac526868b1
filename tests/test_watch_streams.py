"""Streams that a watch cannot rely on are said, and events do not depend on how a stream arrives."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signid
from signid.cli.run import run
from signid.errors import OptionError, RecordingError
from signid.regression.motion import Motion
from signid.simulation.excite.families import rest_to_rest_motion
from signid.watch import Note, Watcher

RATE, DURATION, QUIET = 200.0, 14.0, 4.0


@pytest.fixture(scope="module")
def rows() -> dict[str, Any]:
    """Stream of the 3r in random motion with torque noise, and a push at 11 s."""
    model = signid.load_model("3r")
    asked = rest_to_rest_motion(model.robot, DURATION, 1 / RATE, 4)
    noise = 0.02 * np.random.default_rng(1).standard_normal(asked.q.shape)
    push = np.where((asked.t > 11) & (asked.t < 11.4), 2.0, 0.0)[:, None]
    tau = model.inverse(Motion(model.robot, asked.t, asked.q, asked.v, asked.a)) + noise + push
    return {"t": asked.t, "q": asked.q, "tau": tau}


def csv(rows: dict[str, Any], count: int | None = None) -> str:
    table = np.column_stack([rows["t"], rows["q"], rows["tau"]])[:count]
    lines = [",".join(["t", *(f"{key}_{j}" for key in ("q", "tau") for j in (1, 2, 3))])]
    return "\n".join([*lines, *(",".join(f"{x:.9g}" for x in row) for row in table), ""])


def watched(content: bytes, *options: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "signid", "watch", "3r", "-", "--quiet", str(QUIET), *options]
    return subprocess.run(command, input=content, capture_output=True, env={**os.environ}, timeout=120)


def test_events_do_not_depend_on_how_a_stream_is_cut(rows: dict[str, Any]) -> None:
    t = rows["t"] + np.random.default_rng(2).uniform(-1e-3, 1e-3, len(rows["t"]))
    t[1500:] += 0.3
    found = []
    for size in (1, 7, 64, len(t)):
        watcher = Watcher("3r", quiet=QUIET)
        parts = [slice(k, k + size) for k in range(0, len(t), size)]
        events = [e for part in parts for e in watcher.feed(t[part], rows["q"][part], rows["tau"][part])]
        found.append([e.document() for e in (*events, *watcher.finish())])
    assert len(found[0]) >= 3 and all(other == found[0] for other in found[1:])
    contact = next(e for e in found[0] if e["event"] == "contact")
    assert (
        contact["cause"] is None and np.linalg.norm(contact["direction"]) == pytest.approx(1) and "force" not in contact
    )


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("dead", "joint_2 does not follow"),
        ("noise", "does not follow"),
        ("negated", "wrong sign"),
        ("swapped", "exchanged"),
    ],
)
def test_torque_that_does_not_follow_the_model_is_said(kind: str, said: str, rows: dict[str, Any]) -> None:
    tau = rows["tau"].copy()
    if kind == "dead":
        tau[:, 1] = 0.0
    elif kind == "noise":
        tau = 0.02 * np.random.default_rng(5).standard_normal(tau.shape)
    else:
        tau = -tau if kind == "negated" else tau[:, [1, 0, 2]]
    watcher = Watcher("3r", quiet=QUIET)
    notes = [e.sentence for e in watcher.feed(rows["t"], rows["q"], tau) if isinstance(e, Note)]
    assert len(watcher.flags) == 1 and said in watcher.flags[0] and watcher.flags[0] in notes
    healthy = Watcher("3r", quiet=QUIET)
    healthy.feed(rows["t"], rows["q"], rows["tau"])
    assert not healthy.flags


def test_a_dead_torque_ends_with_exit_code_3(rows: dict[str, Any]) -> None:
    done = watched(csv({**rows, "tau": np.zeros_like(rows["tau"])}).encode())
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 3 and done.stderr.count(b"does not follow the model") == 1
    assert sum("does not follow the model" in e["sentence"] for e in events) == 1


@pytest.mark.parametrize("step", [1e3, 1e6, 1e9])
def test_stamps_in_other_units_are_refused(step: float, rows: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be seconds"):
        Watcher("3r").feed(rows["t"] * step, rows["q"], rows["tau"])
    (tmp_path / "rows.csv").write_text(csv({**rows, "t": rows["t"] * step}))
    assert run(["watch", "3r", str(tmp_path / "rows.csv")]) == 2


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_encodings_with_a_mark_are_read(encoding: str, rows: dict[str, Any]) -> None:
    mark = "\ufeff" if encoding == "utf-16-le" else ""
    done = watched((mark + csv(rows, 2600)).encode(encoding))
    assert done.returncode == 0 and b"watching" in done.stdout, done.stderr


def test_a_stream_without_thresholds_is_flagged(rows: dict[str, Any]) -> None:
    done = watched(csv(rows, 400).encode())
    assert done.returncode == 3 and not done.stdout and b"nothing was watched" in done.stderr


@pytest.mark.parametrize("kind", ["pipe", "folder"])
def test_what_replaces_a_followed_file_ends_the_watch(kind: str, rows: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text(csv(rows, 50))

    def replace() -> None:
        time.sleep(0.5)
        path.unlink()
        path.mkdir() if kind == "folder" else os.mkfifo(path)

    thread = threading.Thread(target=replace)
    thread.start()
    assert run(["watch", "3r", str(path), "--follow", "--idle", "20"]) == 2
    thread.join()


def test_arrays_of_wrong_shapes_are_refused_and_masked_values_are_missing(rows: dict[str, Any]) -> None:
    t, q, tau = (rows[key][:300] for key in ("t", "q", "tau"))
    wrong: list[tuple[Any, ...]] = [
        (t[:-1], q, tau),
        (t, q[:, :2], tau),
        (t, q, tau[:-1]),
        (t, q, tau, q[:, :1]),
        (t[:, None], q, tau),
        (t, q.ravel(), tau),
        (0.0, q[0], tau[0]),
        (t.astype(str), q, tau),
        (t, q + 1j, tau),
        (t, None, tau),
        (t, [[1, 2, 3], [1]], tau),
    ]
    for given in wrong:
        with pytest.raises(OptionError, match="of the rows"):
            Watcher("3r").feed(*given)
    for options in ({"quiet": "4"}, {"quiet": None}, {"sensitivity": []}, {"quiet": float("nan")}):
        with pytest.raises(OptionError):
            Watcher("3r", **options)
    masked = np.ma.masked_equal(np.where(np.arange(300)[:, None] % 50, tau, 999.0), 999.0)
    watcher = Watcher("3r")
    notes = watcher.feed(t, q, masked)
    assert watcher.used < 300 and "without a number" in notes[0].document()["sentence"]
