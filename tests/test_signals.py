"""Ctrl-C, SIGTERM and time limits: the best answer so far, whole and flagged, or none at all."""

from __future__ import annotations

import json
import os
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
from signid.deadline import OutOfTimeError, need_time, show_step, steps_shown, stop_searches, time_is_up, time_limit

ROOT = Path(__file__).parents[1]
THERE = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
LIMIT, SPARE = 1.0, 2.0  # [s] less than a fifth of the diagnosis; [1] beyond it, processor time over that of a fit
SECONDS = 40  # of the recording
SIGNALS = [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM")]
FILES = {
    "diagnose": ["diagnosis.json", "model.json", "report.html", "robot.urdf"],
    "identify": ["identification.json", "model.json", "report.html", "robot.urdf"],
}
COMMANDS = {"diagnose": (), "identify": ("--method", "pbrp")}
SIGNALLED = """
import signal, sys
import signid.__main__ as program
from signid import deadline

event, number, times, *sys.argv[1:] = sys.argv[1:]
sent = False

def send():
    global sent
    if not sent:
        sent = True
        for _ in range(int(times)):
            signal.raise_signal(int(number))

def answered(limit, value):
    limit.__dict__["searching"] = value
    if value:
        send()

if event == "first answer":
    deadline._Limit.searching = property(lambda limit: limit.__dict__["searching"], answered)
else:
    sys.addaudithook(lambda what, given: what == "open" and str(given[0]).endswith(event) and send())
program.main()
"""  # signals itself when its search has its first answer, or when it opens a file: no clock is involved


class Ended(NamedTuple):
    code: int
    said: str
    seconds: float  # of processor time


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated panda with laws that its description lacks."""
    path = tmp_path_factory.mktemp("recording") / "panda.parquet"
    words = f"simulate panda --duration {SECONDS} --rate 250 --step 0.002 --noise 0.01"
    laws = [f"{law}@panda_joint{j}" for j, law in ((2, "load_friction"), (4, "stribeck_friction"), (6, "spring"))]
    assert run([*words.split(), *(word for law in laws for word in ("--inject", law)), "-o", str(path)]) == 0
    return path


def ended(program: Sequence[str]) -> Ended:
    """A Python program in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *program], env=THERE, capture_output=True, text=True, timeout=300)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Ended(done.returncode, done.stderr, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def stopped(
    verb: str, path: Path, out: Path, number: signal.Signals, event: str = "first answer", times: int = 1
) -> Ended:
    """A command that gets a signal, once or several times, at an event."""
    words = [verb, "panda", str(path), *COMMANDS[verb], "-o", str(out)]
    return ended(["-c", SIGNALLED, event, str(int(number)), str(times), *words])


def whole(out: Path, verb: str) -> dict[str, object]:
    """The document; all files are there, complete, and nothing else is."""
    assert sorted(path.name for path in out.iterdir()) == FILES[verb]
    assert (out / "report.html").read_text().rstrip().endswith("</html>")
    signid.load_model(out / "model.json")
    document: dict[str, object] = json.loads((out / FILES[verb][0]).read_text())
    return document


@pytest.mark.slow
def test_a_long_diagnosis_ends_in_time(recording: Path, tmp_path: Path) -> None:
    out, words = tmp_path / "out", ("panda", str(recording))
    fit = ended(["-m", "signid", "identify", *words, "--method", "wls", "--json"])  # reads and prepares the same
    found = ended(["-m", "signid", "diagnose", *words, "-o", str(out), "--time-limit", f"{LIMIT:g}"])
    assert found.code == 3
    assert found.seconds < LIMIT + SPARE * fit.seconds
    document = whole(out, "diagnose")
    assert document["rollout"] is None, "what follows the search is bounded, too"
    assert f"the search for laws was cut short after {LIMIT:g} s" in str(document["flags"])
    fits = document["fit"]
    assert isinstance(fits, dict)
    worse = [a > 1.05 * b for b, a in zip(*(fits[key]["held_out_rms"] for key in ("before", "after")), strict=True)]
    loud = [a > 3 * f for f, a in zip(fits["after"]["irreducible_rms"], fits["after"]["held_out_rms"], strict=True)]
    assert not any(w and one for w, one in zip(worse, loud, strict=True)), "never worse than the given simulation"


@pytest.mark.slow_cases("diagnose")
@pytest.mark.parametrize(("verb", "number", "name"), [(v, *s) for v, s in zip(COMMANDS, SIGNALS, strict=True)])
def test_a_signal_leaves_the_best_so_far(
    verb: str, number: signal.Signals, name: str, recording: Path, tmp_path: Path
) -> None:
    found = stopped(verb, recording, tmp_path / "out", number)
    assert found.code == 3, found.said
    assert f"signid: stopped early by {name}: " in found.said
    document = whole(tmp_path / "out", verb)
    assert f"stopped early by {name}: " in str(document["flags"])
    if verb == "identify":
        robot, fit = signid.load_robot("panda"), document["fit"]
        plain = signid.identify(robot, [signid.read_recording(recording, robot)], method="wls").fit.train_rms
        assert isinstance(fit, dict)
        assert all(rms <= 1.051 * least for rms, least in zip(fit["train_rms"], plain, strict=True))


@pytest.mark.slow_cases("first answer|-15-")
@pytest.mark.parametrize(("number", "name"), SIGNALS)
@pytest.mark.parametrize(
    ("event", "times", "words"),
    [
        ("first answer", 2, "again, before the result was complete"),
        ("panda.parquet", 1, "before there was a result"),
    ],
)
def test_a_second_signal_and_one_before_any_answer_leave_nothing(
    event: str, times: int, words: str, number: signal.Signals, name: str, recording: Path, tmp_path: Path
) -> None:
    found = stopped("diagnose", recording, tmp_path / "out", number, event, times)
    assert found.code == 128 + number
    assert found.said == f"signid: {name} ended the command {words}; no file was written\n"
    assert not list(tmp_path.iterdir())


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
    found = ended(["-c", IMPORTING.format(number=int(number))])
    assert (found.code, found.said) == (128 + number, f"signid: {name} ended the command\n")


def test_the_library_has_no_handlers(tmp_path: Path) -> None:
    before = [signal.getsignal(number) for number, _ in SIGNALS]
    assert run(["identify", "3r", str(ROOT / "robots/3r/recording.parquet"), "-o", str(tmp_path / "out")]) == 0
    assert [signal.getsignal(number) for number, _ in SIGNALS] == before


def test_a_stop_waits_for_an_answer() -> None:
    assert not stop_searches("a test")
    with time_limit(1000.0):
        assert not time_is_up("a search", answer=False)
        assert not stop_searches("a test"), "nothing was found yet"
        need_time("a search")
        assert not time_is_up("a search")
        assert stop_searches("a test")
        assert time_is_up("a search")
        with pytest.raises(OutOfTimeError):
            need_time("a search")
    assert not time_is_up("a search")


def test_steps_are_heard_in_their_share_and_never_go_back() -> None:
    heard = list[tuple[str, float]]()
    show_step("nobody listens", 0.5)
    with steps_shown(lambda what, share: heard.append((what, share)), 0.4, 0.6):
        for share in (0.0, 0.5, 0.2, 2.0):
            show_step(f"step {share:g}", share)
    assert [what for what, _ in heard] == ["step 0", "step 0.5", "step 0.2", "step 2"]
    assert [share for _, share in heard] == pytest.approx([0.4, 0.5, 0.5, 0.6])


@pytest.mark.parametrize(
    ("share", "says"),
    [
        (0.5, "2 of 4 sessions: 50 %, about 6 min left, after 3 min"),
        (0.0, "2 of 4 sessions, after 3 min"),
    ],
)
def test_progress_is_a_line_a_minute_where_standard_error_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float, says: str
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
            progress("1 of 4 sessions", share / 2)
            now = 180.0
            progress("2 of 4 sessions", share)
            waits.put(False)
            for _ in range(500):
                if log.read_text():
                    break
                time.sleep(0.01)
    monkeypatch.undo()
    assert log.read_text() == f"signid: {says}\n"
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
        (0.5, 0.5, 600.0, ""),  # nothing is known but a limit that is far off
        (60.0, 0.0, 3540.0, ""),
        (10.0, 0.0, float("inf"), ""),
        (10.0, 0.0, -1.0, "at most 0 s left"),
        (10.0, 1.0, 60.0, ""),
    ],
)
def test_the_remaining_time(elapsed: float, done: float, limit: float, says: str) -> None:
    assert remaining(elapsed, done, 1 - done, limit) == says
