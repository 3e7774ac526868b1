"""Fleets on one machine: manifests, complete or absent sessions, resuming, the summary."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from chromium import Chromium
from fleets import FILES, contents, manifest, record

import signid
from signid.cli import run
from signid.cli.fleet import run as run_module
from signid.cli.fleet.run import Answer, Order, fleet, read_session, spread
from signid.errors import InputError


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a manifest of seven sessions, two of them impossible, and its fleet."""
    folder = tmp_path_factory.mktemp("fleet")
    days = record(folder)
    (folder / "short.csv").write_text("t,q_1,tau_1\n0,0,1\n0.01,0.1,2\n")
    rows = [f"3r,{day},arm 1,2026-01-0{k + 1},identify" for k, day in enumerate(days)]
    rows += [f"3r,{days[2]},arm 2,2026-01-01,", "3r,none.csv,arm 3,,"]
    rows += ["3r,short.csv,arm 4,,identify", f"3r,{days[1]};{days[2]},arm 5,,identify"]
    path = manifest(folder, *rows)
    assert run(["fleet", str(path), "-o", str(folder / "out"), "--workers", "2"]) == 3
    return folder


@pytest.mark.slow
def test_every_session_has_the_files_of_the_single_command(done: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(done)
    names = sorted(path.name for path in (done / "out/sessions").iterdir())
    days = [f"arm-1_2026-01-0{k}_identify" for k in (1, 2, 3)]
    assert names == sorted([*days, "arm-2_2026-01-01", "arm-5_day_1.parquet_identify"])
    single = (
        ["identify", "3r", "day_0.parquet", "-o", "single"],
        ["diagnose", "3r", "day_2.parquet", "-o", "single_2"],
    )
    for words, name in zip(single, (days[0], "arm-2_2026-01-01"), strict=True):
        assert run(words) in (0, 3)
        kept = contents(done / "out/sessions" / name)
        record = json.loads(kept.pop("session.json"))
        assert kept == contents(done / words[-1]) and FILES[words[0]] in kept
        assert record["arguments"] == words[:-2] and list(record["files"]) == sorted(kept)


def test_the_summary_combines_all_sessions(done: Path) -> None:
    summary = json.loads((done / "out/fleet.json").read_text("utf-8"))
    assert [(robot["name"], len(robot["sessions"])) for robot in summary["robots"]][-2:] == [
        ("arm 3", 1),
        ("arm 4", 1),
    ]
    assert summary["robots"][0]["name"] == "arm 2" and summary["robots"][0]["mismatch"] > 10
    assert (
        summary["robots"][0]["joint"] in ("joint_1", "joint_2", "joint_3") and summary["robots"][0]["explained"] > 0.9
    )
    states = {one["session"]: one for one in summary["sessions"]}
    assert states["arm-3_none.csv"]["said"] == ["cannot read none.csv: No such file or directory"]
    assert "too short" in states["arm-4_short.csv_identify"]["said"][0]
    assert {"done", "not done"} <= {one["state"] for one in states.values()} <= {"done", "flagged", "not done"}
    assert summary["robots"][0]["causes"] and len(summary["robots"][0]["lacks"]) == len(summary["robots"][0]["causes"])


class _Links(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if name in ("href", "src") and tag != "link" and value]


def test_the_page_leads_to_every_report_and_needs_no_network(done: Path, tmp_path: Path) -> None:
    text = (done / "out/index.html").read_text("utf-8")
    links = set(_Links(text).found)
    assert len(links) == 5 and all((done / "out" / link).is_file() for link in links)
    assert "cannot read none.csv" in text and len(text) < 2e6
    browser = Chromium(tmp_path, 1200, 900)
    try:
        for width in (390, 1200):
            browser.send("Emulation.setEmulatedMedia", media="screen")
            size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
            browser.send("Emulation.setDeviceMetricsOverride", **size)
            browser.open((done / "out/index.html").as_uri(), "document.querySelectorAll('h2').length > 2")
            assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.errors == [] and all(url.startswith(("file:", "data:")) for url in browser.requests)
    finally:
        browser.close()


def refuse_all(orders: Sequence[Order], *_: object) -> Iterator[tuple[int, Answer]]:
    for k, order in enumerate(orders):
        yield k, Answer(None, (" ".join(order.arguments),), {})


def test_a_missing_file_is_reported_before_any_session_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said: list[str] = []

    def refuse(orders: Sequence[Order], *_: object) -> Iterator[tuple[int, Answer]]:
        said.append(capsys.readouterr().err)
        yield from refuse_all(orders)

    monkeypatch.setattr(run_module, "spread", refuse)
    path = manifest(tmp_path, f"3r,{record(tmp_path, 1)[0]},arm,,identify", "3r,none.csv,arm 2,,")
    assert run(["fleet", str(path), "-o", str(tmp_path / "out")]) == 3
    assert said == ["signid: session arm-2_none.csv (line 3) failed: cannot read none.csv: No such file or directory\n"]
    assert (
        capsys.readouterr().err
        == "signid: session arm_day_0.parquet_identify (line 2) failed: identify 3r day_0.parquet\n"
    )


def test_finished_sessions_are_not_repeated(done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "spread", refuse_all)
    path, out = done / "manifest.csv", done / "out"
    before = contents(out)

    def asked(**options: Any) -> list[str]:
        found = fleet(path, out, **options)
        return [one.said[0] for one in found.outcomes if not one.done and "cannot read" not in one.said[0]]

    assert asked() == ["identify 3r short.csv"]  # failed sessions are tried again
    assert fleet(path, out).reused == 5 and "(5 reused from an earlier run)" in repr(fleet(path, out))
    assert contents(out) == before
    assert len(asked(seed=1)) == 6
    changed = (done / "day_1.parquet").read_bytes()
    try:
        record(done, 1)
        (done / "day_1.parquet").write_bytes((done / "day_0.parquet").read_bytes())
        assert [said.split()[2] for said in asked()] == ["day_1.parquet", "short.csv", "day_1.parquet"]
    finally:
        (done / "day_1.parquet").write_bytes(changed)
    (out / "sessions/arm-2_2026-01-01/report.html").rename(tmp_path / "report.html")
    assert asked() == ["diagnose 3r day_2.parquet", "identify 3r short.csv"]
    (tmp_path / "report.html").rename(out / "sessions/arm-2_2026-01-01/report.html")
    with pytest.raises(InputError, match=r"session arm-3_none\.csv \(line 6\) failed: cannot read"):
        fleet(path, out, keep_going=False)


@pytest.mark.parametrize(
    ("file", "key", "value"),
    [
        ("session.json", "code", None),
        ("session.json", "said", None),
        ("session.json", "files", ["x"]),
        ("session.json", "files", {}),
        ("identification.json", "fit", None),
        ("identification.json", "base_parameters", "x"),
    ],
)
def test_a_stored_session_that_was_changed_is_run_again(
    done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, key: str, value: Any
) -> None:
    monkeypatch.setattr(run_module, "spread", refuse_all)
    shutil.copytree(done / "out", tmp_path / "out")
    place = tmp_path / "out/sessions/arm-1_2026-01-01_identify"
    changed = json.loads((place / file).read_text("utf-8"))
    changed[key] = value
    (place / file).write_text(json.dumps(changed), "utf-8")
    again = [one.said[0] for one in fleet(done / "manifest.csv", tmp_path / "out").outcomes if not one.done]
    assert again[0].startswith("identify 3r day_0.parquet")
    assert read_session(done / "out/sessions" / place.name) and not read_session(place)


def _deadly(order: Order) -> Answer:
    """Kill the process that runs `inspect`."""
    if order.arguments[0] == "inspect":
        os.kill(os.getpid(), signal.SIGKILL)
    return Answer(0, (str(os.getpid()),), {})


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_session_whose_process_dies_does_not_stop_the_others(
    tmp_path: Path, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "carry_out", _deadly)
    orders = [Order((name,), str(tmp_path)) for name in ("inspect", "effects", "check", "data", "demo")]
    found = dict(spread(orders, workers=workers))
    assert found[0].code is None and "its process died" in found[0].said[0]
    assert [found[k].code for k in range(1, 5)] == [0] * 4


def test_a_process_is_warm_for_some_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "carry_out", _deadly)
    monkeypatch.setattr(run_module, "COMMANDS_PER_PROCESS", 2)
    answers = dict(spread([Order(("data",), str(tmp_path))] * 5, workers=1))
    pids = [answers[k].said[0] for k in range(5)]
    assert pids[0] == pids[1] != pids[2] == pids[3] != pids[4]


def test_orders_that_cannot_begin_are_reported(tmp_path: Path) -> None:
    orders = [Order(("check",), str(tmp_path)), Order(("effects",), str(tmp_path / "none")), Order((), "", version="0")]
    found = dict(spread(orders, workers=1))
    assert found[0].code == 2 and "missing argument 'ROBOT'" in found[0].said[0]
    assert "FileNotFoundError" in found[1].said[0] and "it needs the same signid and paths" in found[1].said[0]
    assert found[2].code is None and "0 here); it needs the same signid" in found[2].said[0]


def test_the_processes_of_a_killed_fleet_end(tmp_path: Path) -> None:
    path = manifest(tmp_path, *[f"3r,{day},arm,,identify" for day in record(tmp_path, 3)])
    (tmp_path / "temporary").mkdir()
    command = [sys.executable, "-m", "signid", "fleet", str(path), "-o", str(tmp_path / "out"), "--workers", "1"]
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment) as child:
        while not stored(tmp_path / "out") and child.poll() is None:
            time.sleep(0.02)
        assert list((tmp_path / "temporary").iterdir())
        child.kill()
    while list((tmp_path / "temporary").iterdir()):  # removed by the process as it ends
        time.sleep(0.02)
    assert whole(tmp_path / "out")


@pytest.mark.slow
def test_a_script_without_a_guard_runs_a_fleet_once(tmp_path: Path) -> None:
    path = manifest(tmp_path, f"3r,{record(tmp_path, 1)[0]},arm,,identify")
    script = tmp_path / "script.py"
    script.write_text(f"import signid\nprint(len(signid.fleet({str(path)!r}, 'out').outcomes))\n")
    done = subprocess.run([sys.executable, script.name], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "1\n" and done.stderr == "" and len(whole(tmp_path / "out")) == 1


def stored(folder: Path) -> list[Path]:
    """Folders of all stored sessions."""
    return [path.parent for path in (folder / "sessions").glob("*/session.json")]


def whole(folder: Path) -> list[str]:
    """Names of all stored sessions, after a check that each is complete."""
    names = []
    for place in stored(folder):
        kept = {name: content for name, content in contents(place).items() if not name.startswith(".")}
        assert sorted([*json.loads(kept["session.json"])["files"], "session.json"]) == sorted(kept)
        assert json.loads(kept["identification.json"]) and kept["report.html"].rstrip().endswith(b"</html>")
        names.append(place.name)
    return sorted(names)


def test_ctrl_c_and_kill_leave_complete_sessions_and_the_next_run_does_the_rest(tmp_path: Path) -> None:
    rows = [f"3r,{day},arm,,identify" for day in record(tmp_path, 3)]
    path, out, expected = (
        manifest(tmp_path, *rows),
        tmp_path / "out",
        [f"arm_day_{k}.parquet_identify" for k in range(3)],
    )

    def interrupt(what: str, share: float) -> None:
        if what.startswith("1 of"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fleet(path, out, workers=1, progress=interrupt)
    assert whole(out) == expected[:1]
    command = [sys.executable, "-m", "signid", "fleet", str(path), "-o", str(out), "--workers", "1"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        while len(stored(out)) < 2 and child.poll() is None:
            time.sleep(0.02)
        child.kill()
    assert expected[:2] == whole(out)[:2] and not (out / "index.html").exists()
    kept, found = len(whole(out)), fleet(path, out, workers=1)
    assert found.document()["sessions"][2]["state"] in ("done", "flagged") and found.reused == kept
    assert whole(out) == expected


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="no groups of processes")
def test_ctrl_c_in_a_terminal_stops_only_the_parent_process(tmp_path: Path) -> None:
    path = manifest(tmp_path, *[f"3r,{day},arm,,diagnose" for day in record(tmp_path, 4)])
    hears = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # also where pytest does not
    program = f"{hears}; from signid.cli import main; main()"
    command = [sys.executable, "-c", program, "fleet", str(path), "-o", str(tmp_path / "out"), "--workers", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as child:
        while not stored(tmp_path / "out") and child.poll() is None:
            time.sleep(0.02)
        os.killpg(child.pid, signal.SIGINT)
        _, output = child.communicate()
    assert child.returncode == 130 and "repeat the command to continue" in output
    assert len(stored(tmp_path / "out")) == 1, "nothing is done again"


def test_an_unwritable_folder_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = manifest(tmp_path, f"3r,{record(tmp_path, 1)[0]},arm,,identify")
    (tmp_path / "out").mkdir()
    (tmp_path / "out/sessions").write_text("")
    assert run(["fleet", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "cannot write results to" in capsys.readouterr().err


def test_the_verb_is_public() -> None:
    assert signid.fleet is fleet
