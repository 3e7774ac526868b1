"""Ctrl-C, SIGTERM and time limits: the best answer so far, whole and flagged, or none at all."""

from __future__ import annotations

import json
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from queue import Queue
from typing import NamedTuple

import pytest

import signid
from signid.cli import run, terminal
from signid.cli.terminal import bars, remaining
from signid.deadline import show_step, steps_shown

ROOT = Path(__file__).parents[1]
THERE = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
LIMIT, SPARE = 1.0, 2.0  # [s] less than a fifth of the diagnosis; [1] beyond it, processor time over that of a fit
SIGNALS = [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM")]
FILES = {
    "diagnose": ["diagnosis.json", "model.json", "report.html", "robot.urdf"],
    "identify": ["identification.json", "model.json", "report.html", "robot.urdf"],
}
COMMANDS = {"diagnose": (), "identify": ("--method", "pbrp")}
BEGUN = {"diagnose": ("weighing laws", 0.0), "identify": ("judging by", 1.0)}  # what is shown so long [s] before
CODES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")  # of a terminal


class Ended(NamedTuple):
    code: int
    said: str
    seconds: float  # of processor time


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty seconds of a simulated panda with laws that its description lacks."""
    path = tmp_path_factory.mktemp("short") / "panda.parquet"
    words = "simulate panda --duration 40 --rate 250 --step 0.002 --noise 0.01"
    laws = [f"{law}@panda_joint{j}" for j, law in ((2, "load_friction"), (4, "stribeck_friction"), (6, "spring"))]
    assert run([*words.split(), *(word for law in laws for word in ("--inject", law)), "-o", str(path)]) == 0
    return path


def command(words: Sequence[str], signals: Sequence[tuple[float, signal.Signals]]) -> Ended:
    """A command in a process of its own that gets signals at delays [s] after its start or the signal before."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen(
        [sys.executable, "-m", "signid", *words],
        env=THERE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as child:
        for seconds, number in signals:
            time.sleep(seconds)
            child.send_signal(number)
        _, said = child.communicate(timeout=300)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Ended(child.returncode, said, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def stopped(verb: str, path: Path, out: Path, number: signal.Signals, again: bool = False) -> Ended:
    """A command in a terminal that gets a signal once its search has begun, and perhaps another one."""
    words = [verb, "panda", str(path), *COMMANDS[verb], "-o", str(out)]
    (shown, seconds), (ours, its) = BEGUN[verb], pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "signid", *words], env={**THERE, "TERM": "xterm"}, stdout=subprocess.DEVNULL, stderr=its
    ) as child:
        os.close(its)
        said, sent = "", False
        while piece := _piece(ours):
            said += piece
            if shown in said and not sent:
                time.sleep(seconds)
                sent = True
                for _ in range(1 + again):
                    child.send_signal(number)
                    time.sleep(0.1)
    os.close(ours)
    return Ended(child.returncode, CODES.sub("", said).replace("\r\n", "\n"), 0.0)


def _piece(terminal: int) -> str:
    """Text written to a terminal, empty once the writer has ended."""
    try:
        return os.read(terminal, 65536).decode(errors="replace")
    except OSError:
        return ""


def whole(out: Path, verb: str) -> dict[str, object]:
    """The document; all files are there, complete, and nothing else is."""
    assert sorted(path.name for path in out.iterdir()) == FILES[verb]
    assert (out / "report.html").read_text().rstrip().endswith("</html>")
    signid.load_model(out / "model.json")
    document: dict[str, object] = json.loads((out / FILES[verb][0]).read_text())
    return document


def test_a_long_diagnosis_ends_in_time(short: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    fit = command(["identify", "panda", str(short), "--method", "wls", "--json"], [])  # reads and prepares the same
    ended = command(["diagnose", "panda", str(short), "-o", str(out), "--time-limit", f"{LIMIT:g}"], [])
    assert ended.code == 3
    assert ended.seconds < LIMIT + SPARE * fit.seconds
    document = whole(out, "diagnose")
    assert document["rollout"] is None, "what follows the search is bounded, too"
    assert f"the search for laws was cut short after {LIMIT:g} s" in str(document["flags"])
    fits = document["fit"]
    assert isinstance(fits, dict)
    worse = [a > 1.05 * b for b, a in zip(*(fits[key]["held_out_rms"] for key in ("before", "after")), strict=True)]
    loud = [a > 3 * f for f, a in zip(fits["after"]["irreducible_rms"], fits["after"]["held_out_rms"], strict=True)]
    assert not any(w and one for w, one in zip(worse, loud, strict=True)), "never worse than the given simulation"


@pytest.mark.parametrize(("verb", "number", "name"), [("diagnose", *SIGNALS[0]), ("identify", *SIGNALS[1])])
def test_a_signal_leaves_the_best_so_far(
    verb: str, number: signal.Signals, name: str, short: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    ended = stopped(verb, short, out, number)
    assert ended.code == 3, ended.said
    assert f"signid: stopped early by {name}: " in ended.said
    assert f"stopped early by {name}: " in str(whole(out, verb)["flags"])


def test_an_identification_that_was_stopped_is_not_worse_than_least_squares(short: Path, tmp_path: Path) -> None:
    assert stopped("identify", short, tmp_path / "out", signal.SIGTERM).code == 3
    robot = signid.load_robot("panda")
    plain = signid.identify(robot, [signid.read_recording(short, robot)], method="wls").fit.train_rms
    fit = whole(tmp_path / "out", "identify")["fit"]
    assert isinstance(fit, dict)
    assert all(rms <= 1.051 * least for rms, least in zip(fit["train_rms"], plain, strict=True))


def test_a_second_signal_ends_at_once(short: Path, tmp_path: Path) -> None:
    out, (number, name) = tmp_path / "out", SIGNALS[0]
    ended = stopped("diagnose", short, out, number, again=True)
    assert ended.code == 128 + number
    assert f"signid: {name} ended the command again, before the result was complete; no file was" in ended.said
    assert not out.exists() and not list(tmp_path.rglob(".signid-*"))


def test_a_signal_before_any_answer_leaves_nothing(short: Path, tmp_path: Path) -> None:
    out, (number, name) = tmp_path / "out", SIGNALS[1]
    ended = command(["diagnose", "panda", str(short), "-o", str(out)], [(1.5, number)])
    assert ended.code == 128 + number
    assert ended.said.splitlines() == [
        f"signid: {name} ended the command before there was a result; no file was written"
    ]
    assert not out.exists()


IMPORTING = """
import os, signal, sys
import signid.__main__ as program

class Interrupted:
    def find_spec(self, name, *rest):
        if name == "signid.cli.app":
            os.kill(os.getpid(), {number})

sys.meta_path.insert(0, Interrupted())
program.main()
"""


@pytest.mark.parametrize(("number", "name"), SIGNALS)
def test_a_signal_while_modules_are_imported_is_one_sentence(number: signal.Signals, name: str) -> None:
    program = IMPORTING.format(number=int(number))
    done = subprocess.run([sys.executable, "-c", program], env=THERE, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (128 + number, f"signid: {name} ended the command\n")


def test_steps_are_heard_in_their_share_and_never_go_back() -> None:
    heard = list[tuple[str, float]]()
    show_step("nobody listens", 0.5)
    with steps_shown(lambda what, share: heard.append((what, share)), 0.4, 0.6):
        for share in (0.0, 0.5, 0.2, 2.0):
            show_step(f"step {share:g}", share)
    assert [what for what, _ in heard] == ["step 0", "step 0.5", "step 0.2", "step 2"]
    assert [share for _, share in heard] == pytest.approx([0.4, 0.5, 0.5, 0.6])


def test_progress_is_a_line_a_minute_where_standard_error_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: Queue[bool] = Queue()
    now = 0.0
    log = tmp_path / "log"

    class FakeEvent:
        def wait(self, seconds: float) -> bool:
            assert seconds == 60.0
            return waits.get(timeout=10)

        def set(self) -> None:
            waits.put(True)

    monkeypatch.setattr(terminal, "Event", FakeEvent)
    with log.open("w") as stream:
        monkeypatch.setattr("sys.stderr", stream)
        monkeypatch.setattr(terminal.time, "monotonic", lambda: now)
        with bars(quiet=False, one=True) as progress:
            assert progress is not None
            progress("1 of 4 sessions", 0.25)
            now = 180.0
            progress("2 of 4 sessions", 0.5)
            waits.put(False)
            for _ in range(500):
                if log.read_text():
                    break
                time.sleep(0.01)
    monkeypatch.undo()
    assert log.read_text() == "signid: 2 of 4 sessions: 50 %, about 6 min left, after 3 min\n"
    monkeypatch.setattr("sys.stderr", StringIO())
    with bars(quiet=False) as nothing:
        assert nothing is None, "lines of a session of a fleet are its flags"


@pytest.mark.parametrize(
    ("elapsed", "done", "limit", "says"),
    [
        (10.0, 0.5, float("inf"), "about 10 s left"),
        (10.0, 0.5, 30.0, "about 10 s, at most 30 s left"),
        (10.0, 0.5, 3600.0, "about 10 s left"),
        (10.0, 0.5, 4.0, "at most 4 s left"),
        (0.5, 0.5, 600.0, "at most 10 min left"),
        (10.0, 0.0, float("inf"), ""),
        (10.0, 0.0, -1.0, "at most 0 s left"),
        (10.0, 1.0, 60.0, ""),
    ],
)
def test_the_remaining_time(elapsed: float, done: float, limit: float, says: str) -> None:
    assert remaining(elapsed, done, 1 - done, limit) == says
