"""All readers stand behind all commands that read recordings: bags and datasets as well as tables."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from bags import START, state, store, write2
from swing import npz, pristine, swing
from test_recording_formats_lerobot import dataset, rows

from signid.cli import run

COMMANDS = {
    "check": "check 1r {}",
    "replay": "replay 1r {} --html {}.html --duration 2",
    "validate": "validate 1r {}",
    "simulate a motion": "simulate 1r --motion {} -o {}.motion.csv",
    "simulate a torque": "simulate 1r --torque {} -o {}.torque.csv",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sources")
    known, (t, q, tau) = store(), pristine().values()
    messages = [
        ("/js", state(known, START + round(s * 1e9), ["joint_1"], [a], [], [b]), START + round(s * 1e9))
        for s, a, b in zip(t, q, tau, strict=True)
    ]
    write2(folder / "bag", known, messages)
    (folder / "table.npz").write_bytes(npz(swing()))
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_a_bag_is_read_as_a_table_is(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    codes = [run(shlex.split(COMMANDS[name].replace("{}", source))) for source in ("bag", "table.npz")]
    assert codes in ([0, 0], [3, 3]), capfd.readouterr().err


def test_a_bag_has_the_numbers_of_the_table(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert [run(["identify", "1r", source, "-o", f"from/{source}"]) for source in ("bag", "table.npz")] == [0, 0]
    texts = (Path("from", source, "identification.json").read_text() for source in ("bag", "table.npz"))
    one, other = (json.loads(text) for text in texts)
    assert [p["value"] for p in one["base_parameters"]] == pytest.approx(
        [p["value"] for p in other["base_parameters"]], rel=1e-6
    )
    assert [file["path"] for file in one["inputs"]].count("bag") == 1


def test_a_replay_of_a_dataset_needs_only_its_units(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    t = np.arange(400) / 50
    columns = {"observation.state": np.degrees(np.sin(2 * t))[:, None], "observation.effort": np.cos(2 * t)[:, None]}
    table: pl.DataFrame = rows(0, len(t), **columns)
    places = {"data/chunk-000/file-000.parquet": table}
    dataset(tmp_path / "d", places, names=["joint_1"], features=["observation.effort"])
    Path("map.toml").write_text('[units]\nq = "deg"\ntau = "N.m"\n')
    assert run(shlex.split("replay 1r d --columns map.toml --html d.html --duration 2")) == 0, capfd.readouterr().err
    assert Path("d.html").stat().st_size > 1e5
    assert run(shlex.split("replay 1r d --html d.html")) == 3
    assert "check the unit of q " in capfd.readouterr().err and 'q = "deg"' in Path("d.reading.toml").read_text()
