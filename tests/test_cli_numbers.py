"""Numbers of options: each is bounded before any work begins."""

from __future__ import annotations

import shlex
import time
from pathlib import Path

import pytest
from swing import csv, swing

from signid.cli import run

OPTIONS = {
    "excite 3r -o out.csv": "--duration 1e300;--duration 1e9;--rate inf;--rate 1e300;--rate 1e9;--rate nan;"
    "--clearance 1e300;--torque-scale 1e300;--kind random --duration 1e5;--harmonics 1000000000000;--lock 1=1e300;"
    "--seed 99999999999999999999999;--separate torque_lag@1,time_delay@1 --rate 1e9",
    "simulate 1r --motion m.csv -o out.csv": "--noise 1e308;--coloured-noise 1e308;--jitter 1e300;--rate 1e300;"
    "--step 1e-310;--step 1e-12;--duration 1e300;--bandwidth 1e300;--feed-forward 1e300;--encoder-bits 1e300;"
    "--kp 1e308 --kd 1;--substeps 100000000000000",
    "replay 1r m.csv --html out.html": "--horizon 1e300;--fps 1e300;--rate 1e300;--from 1e300;--duration 1e300",
    "identify 1r m.csv --json": "--cutoff 1e300;--time-limit 1e-300",
}
LAWS = "torque_lag@1:time_constant coulomb_friction@1:level payload:mass time_delay@1:delay spring@1:rest".split()


def refused(command: str, capfd: pytest.CaptureFixture[str]) -> str:
    start = time.process_time()
    code = run(shlex.split(command))
    out, err = capfd.readouterr()
    assert (code, out) == (2, ""), (command, code, err)
    assert len(err.splitlines()) == 1 and time.process_time() - start < 10, err
    assert not list(Path().glob("out*"))
    return err


@pytest.mark.parametrize(
    ("command", "given"), [(command, given) for command, all_ in OPTIONS.items() for given in all_.split(";")]
)
def test_numbers_of_options_are_bounded(
    command: str, given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("m.csv").write_text(csv(swing()))
    refused(f"{command} {given}", capfd)


@pytest.mark.parametrize("value", ["1e308", "-1e300", "1e10", "inf"])
@pytest.mark.parametrize("law", LAWS)
def test_numbers_of_laws_are_bounded(
    law: str, value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("m.csv").write_text(csv(swing()))
    assert law.partition("@")[0].partition(":")[0] in refused(
        f"simulate 1r --motion m.csv -o out.csv --inject {law}={value}", capfd
    )
