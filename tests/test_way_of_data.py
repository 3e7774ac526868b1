"""The way of the data: a command enters few files, none about position drives, and prepares a recording once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from signid.effects import DRIVE_EFFECTS

ROOT = Path(__file__).parents[1]
ROBOT, RECORDING = (str(ROOT / "robots" / "3r" / name) for name in ("robot.urdf", "recording.parquet"))
FEWEST = {"identify": (90, 180), "diagnose": (160, 260)}  # files in which a function is called, and loaded ones
DRIVES = {
    "servos.py",
    "cli/commands/drives.py",
    "effects/drive.py",
    "effects/motor_friction.py",
    "effects/packing.py",
    "output/export/drives.py",
    "simulation/plant/drives.py",
    *(f"effects/{effect.name}.py" for effect in DRIVE_EFFECTS),
}
ROOMS = ("servo/", "faults/commands/", "output/replay/")

TRACE = """
import inspect, json, runpy, sys, threading
from collections import Counter

root, report, *arguments = sys.argv[1:]
files, seen, calls = set(), set(), Counter()
COUNTED = ("prepare", "survey", "Recording.read")

def enter(frame, event, given):
    code = frame.f_code
    if event != "call" or not code.co_filename.startswith(root):
        return
    calls[code.co_qualname] += code.co_qualname in COUNTED
    if code not in seen:
        seen.add(code)
        if code.co_flags & inspect.CO_OPTIMIZED and code.co_name not in LOOPS and code.co_filename.endswith(".py"):
            files.add(code.co_filename.removeprefix(root))

LOOPS = ("<listcomp>", "<dictcomp>", "<setcomp>", "<genexpr>")  # no functions; they belong to the one around them
sys.argv = ["signid", *arguments]
threading.setprofile(enter)
sys.setprofile(enter)
try:
    runpy.run_module("signid", run_name="__main__")
finally:
    sys.setprofile(None)
    loaded = [name for name in sys.modules if name.partition(".")[0] == "signid"]
    found = {"entered": sorted(files), "loaded": loaded, "calls": calls, "numba": "numba" in sys.modules}
    with open(report, "w") as stream:
        json.dump(found, stream)
"""


pytestmark = pytest.mark.slow_cases("diagnose")


@pytest.fixture(scope="module", params=list(FEWEST))
def traced(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any]]:
    """A verb on the recording of the 3R arm, and what the command entered, loaded and called."""
    verb, folder = request.param, tmp_path_factory.mktemp("way")
    report, package = folder / "trace.json", f"{ROOT / 'signid'}{os.sep}"
    command = [sys.executable, "-c", TRACE, package, str(report), verb, ROBOT, RECORDING, "-o", str(folder / "result")]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert done.returncode in (0, 3), done.stderr
    return verb, json.loads(report.read_text(encoding="utf-8"))


def test_a_command_enters_and_loads_few_files(traced: tuple[str, dict[str, Any]]) -> None:
    verb, found = traced
    entered, loaded = FEWEST[verb]
    assert len(found["entered"]) <= entered, found["entered"]
    assert len(found["loaded"]) <= loaded, sorted(found["loaded"])


def test_torque_enters_no_file_about_position_drives(traced: tuple[str, dict[str, Any]]) -> None:
    found = traced[1]
    assert [file for file in found["entered"] if file in DRIVES or file.startswith(ROOMS)] == []
    assert not found["numba"]


def test_a_command_prepares_a_recording_once(traced: tuple[str, dict[str, Any]]) -> None:
    verb, found = traced
    assert (found["calls"]["prepare"], found["calls"]["survey"]) == (1, 1)
    assert found["calls"]["Recording.read"] <= {"identify": 17, "diagnose": 177}[verb]  # parts of decoded columns
    assert all(call in found["calls"] for call in ("prepare", "survey", "Recording.read"))
