"""LeRobot datasets: episodes one after the other, joints by their names, and units that must be said."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from bags import JOINTS, swung
from test_recording import arm
from test_recording_formats import refusal, sentence

from signid.errors import RecordingError, UndecidedReading
from signid.recording import read_recording
from signid.recording.formats import FORMATS, base
from signid.recording.formats.base import About
from signid.recording.reading import draft_map

FPS = 50
DEGREES = {"units": {"q": "deg", "q_des": "deg", "tau": "N.m", "dq": "deg/s", "current": "mA"}}


def rows(episode: int, n: int, start: int = 0, **features: np.ndarray) -> pl.DataFrame:
    """An episode as LeRobot writes it: float32 stamps that are numbers of frames over fps."""
    frame = np.arange(n)
    columns = {name: values[start : start + n].astype(np.float32) for name, values in features.items()}
    return pl.DataFrame(
        {
            **{name: pl.Series(values.tolist(), dtype=pl.List(pl.Float32)) for name, values in columns.items()},
            "timestamp": (frame / FPS).astype(np.float32),
            "frame_index": frame,
            "episode_index": np.full(n, episode),
            "task_index": np.zeros(n, np.int64),
        }
    )


def dataset(
    folder: Path, tables: dict[str, pl.DataFrame], names: object = JOINTS, features: Sequence[str] = (), **more: Any
) -> Path:
    """A dataset's folder; every feature has the same names."""
    (folder / "meta").mkdir(parents=True)
    known = ["observation.state", "action", *features]
    info = {"codebase_version": "v2.1", "fps": FPS, "features": {name: {"names": names} for name in known}, **more}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    for place, table in tables.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        table.write_parquet(folder / place)
    return folder


def motion(n: int = 300) -> dict[str, np.ndarray]:
    _, q, _, tau = swung(n, FPS)
    return {"observation.state": np.degrees(q), "action": np.degrees(q) + 1, "observation.effort": tau}


def two_episodes(folder: Path, together: bool) -> Path:
    first, second = rows(3, 120, **motion()), rows(7, 180, 120, **motion())
    places = [f"data/chunk-000/episode_{k:06d}.parquet" for k in (3, 7)]
    tables = dict(zip(places, (first, second), strict=True))
    if together:
        tables = {"data/chunk-000/file-000.parquet": pl.concat([second, first])}
    return dataset(folder / "d", tables, features=["observation.effort"])


@pytest.mark.parametrize("together", [True, False], ids=["v3", "v2"])
def test_episodes_follow_each_other(together: bool, tmp_path: Path) -> None:
    path = two_episodes(tmp_path, together)
    assert [name for name in FORMATS.names if FORMATS[name].recognises(path)] == ["lerobot"]
    recording = read_recording(path, arm(), columns=DEGREES)
    samples, (_, q, _, tau) = recording.read(), swung(300, FPS)
    np.testing.assert_allclose(samples.q, q, atol=1e-6)
    np.testing.assert_allclose(samples.tau, tau, atol=1e-5)
    assert samples.q_des is not None
    np.testing.assert_allclose(samples.q_des, q + np.pi / 180, atol=1e-6)
    steps = np.diff(samples.t)
    np.testing.assert_allclose(np.delete(steps, 119), 1 / FPS, atol=1e-12)
    assert steps[119] == pytest.approx(1.0), "episodes are stretches"
    sentence("; ".join(recording.notes), "2 episodes (3, 7)", "frame index at 50 Hz")


def test_one_file_of_a_dataset(tmp_path: Path) -> None:
    folder = two_episodes(tmp_path, together=False)
    path = folder / "data" / "chunk-000" / "episode_000007.parquet"
    assert len(read_recording(path, arm(), columns=DEGREES)) == 180
    assert read_recording(folder, arm(), columns=DEGREES).sha256 != read_recording(path, arm(), columns=DEGREES).sha256
    alone = tmp_path / "episode_000007.parquet"
    alone.write_bytes(path.read_bytes())
    with pytest.raises(RecordingError, match="no column 't'"):
        read_recording(alone, arm(), columns=DEGREES)


@pytest.mark.parametrize("missing", ["q", "tau", "q_des"])
def test_units_are_not_guessed(missing: str, tmp_path: Path) -> None:
    path = two_episodes(tmp_path, together=True)
    said = {"units": {kind: unit for kind, unit in DEGREES["units"].items() if kind != missing}}
    with refusal("does not state the unit", f"{missing}_shoulder", f"--unit {missing}="):
        read_recording(path, arm(), columns=said)


def test_a_drafted_map_asks_about_units_of_positions(tmp_path: Path) -> None:
    path = two_episodes(tmp_path, together=True)
    text = draft_map(path, arm()).text
    with pytest.raises(UndecidedReading, match="check the unit of q "):  # the command writes it, and ends with 3
        read_recording(path, arm())
    asked = [
        line for line in text.splitlines() if line.endswith("CHECK") and "per cent of the calibrated range" in line
    ]
    assert [line.partition(" ")[0] for line in asked] == ["q", "q_des"]


def test_shares_of_the_range_by_scale_and_offset(tmp_path: Path) -> None:
    share = {"observation.state": motion()["observation.state"], "observation.effort": motion()["observation.effort"]}
    path = dataset(tmp_path / "d", {"data/chunk-000/file-000.parquet": rows(0, 300, **share)})
    columns = {"q_elbow": {"column": "q_elbow", "scale": 0.02, "offset": -0.5}, **DEGREES}
    q = read_recording(path, arm(), columns=columns).read().q
    np.testing.assert_allclose(q[:, 1], share["observation.state"][:, 1] * 0.02 - 0.5, atol=1e-5)
    np.testing.assert_allclose(q[:, 0], swung(300, FPS)[1][:, 0], atol=1e-6)


NAMES: dict[str, tuple[object, tuple[str, ...]]] = {
    "plain": (["a", "b", "c"], ("q_a", "q_des_b")),
    "with endings": (["a.pos", "b.pos", "c.pos"], ("q_a", "q_des_b", "tau_c")),
    "several states in one": (["a.pos", "a.vel", "a.torque"], ("q_a", "dq_a", "tau_a", "q_des_a", "action_a.vel")),
    "below motors": ({"motors": ["a", "b", "c"]}, ("q_a", "q_des_b")),
    "none": (None, ("q_1", "q_des_2", "tau_3")),
    "too few": (["a"], ("q_1", "q_des_2")),
    "numbers": ([1, 2, 3], ("q_1", "q_des_3")),
}


@pytest.mark.parametrize("case", NAMES)
def test_names(case: str, tmp_path: Path) -> None:
    names, wanted = NAMES[case]
    path = dataset(tmp_path / "d", {"data/c/f.parquet": rows(0, 30, **motion())}, names, ["observation.effort"])
    table = FORMATS["lerobot"].open(path)
    assert {"t", *wanted} <= set(table.columns), table.columns
    assert About.of(table).unstated == set(table.columns) - {"t"}
    assert ("in turn" in "; ".join(About.of(table).notes)) == ("q_1" in wanted)


def test_stamps_that_were_measured_are_kept(tmp_path: Path) -> None:
    t = (np.arange(100) / FPS + 0.002 * np.sin(np.arange(100))).astype(np.float32)
    frame = rows(0, 100, **motion()).with_columns(pl.Series("timestamp", t))
    for k, kept in enumerate((frame, frame.drop("frame_index"), frame.drop("episode_index"))):
        table = FORMATS["lerobot"].open(dataset(tmp_path / str(k), {"data/c/f.parquet": kept}))
        np.testing.assert_allclose(table.read(("t",), 0, 100)[:, 0], t - t[0], atol=1e-12)
    table = FORMATS["lerobot"].open(dataset(tmp_path / "n", {"data/c/f.parquet": frame.drop("timestamp")}))
    np.testing.assert_allclose(table.read(("t",), 0, 100)[:, 0], np.arange(100) / FPS)


def test_links_of_a_cache_are_followed(tmp_path: Path) -> None:
    folder = two_episodes(tmp_path, together=True)
    table = next(folder.glob("data/*/*.parquet"))
    table.symlink_to(table.rename(tmp_path / "blob"))
    assert len(read_recording(folder, arm(), columns=DEGREES)) == 300


def test_a_dataset_without_torque_says_so(tmp_path: Path) -> None:
    path = dataset(
        tmp_path / "d",
        {"data/c/f.parquet": rows(0, 30, action=motion()["action"], **{"observation.state": motion()["action"]})},
    )
    table = FORMATS["lerobot"].open(path)
    assert "a recording of servos" in "; ".join(About.of(table).notes)


Change = Callable[[Path], object]


def info(**more: object) -> Change:
    return lambda folder: (folder / "meta" / "info.json").write_text(json.dumps({"fps": FPS, "features": {}, **more}))


def table(change: Callable[[pl.DataFrame], pl.DataFrame]) -> Change:
    def write(folder: Path) -> None:
        change(rows(0, 30, **motion())).write_parquet(next(folder.glob("data/*/*.parquet")))

    return write


BAD: dict[str, tuple[Change, str]] = {
    "no JSON": (lambda folder: (folder / "meta" / "info.json").write_text("{"), "valid LeRobot description"),
    "not UTF-8": (lambda folder: (folder / "meta" / "info.json").write_bytes(b"\xff{}"), "valid LeRobot description"),
    "a list": (lambda folder: (folder / "meta" / "info.json").write_text("[1]"), "valid LeRobot description"),
    "endless brackets": (
        lambda folder: (folder / "meta" / "info.json").write_text("[" * 100_000),
        "valid LeRobot description",
    ),
    "no rate": (info(fps=None), "fps"),
    "rate zero": (info(fps=0), "fps"),
    "rate infinite": (info(fps=float("inf")), "fps"),
    "features in a list": (info(features=[1]), "features"),
    "no tables": (lambda folder: next(folder.glob("data/*/*.parquet")).unlink(), "no tables"),
    "table cut short": (lambda folder: next(folder.glob("data/*/*.parquet")).write_bytes(b"PAR1"), "cut short"),
    "no state": (table(lambda frame: frame.drop("observation.state")), "observation.state"),
    "no time": (table(lambda frame: frame.drop("timestamp", "frame_index")), "timestamp"),
    "words": (table(lambda frame: frame.with_columns(pl.lit("up").alias("action"))), "action"),
    "ragged": (
        table(lambda frame: frame.with_columns(pl.Series("action", [[1.0] * (1 + k % 2) for k in range(30)]))),
        "lengths",
    ),
    "lists of words": (table(lambda frame: frame.with_columns(pl.Series("action", [["a"]] * 30))), "action holds List"),
}


@pytest.mark.parametrize("case", BAD)
def test_datasets_that_cannot_be_read(case: str, tmp_path: Path) -> None:
    change, culprit = BAD[case]
    path = two_episodes(tmp_path, together=True)
    change(path)
    with refusal(str(path), culprit):
        read_recording(path, arm(), columns=DEGREES)


def test_datasets_larger_than_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = two_episodes(tmp_path, together=True)
    monkeypatch.setattr(base, "free_memory", lambda: 1000.0)
    with pytest.raises(RecordingError, match="GB of memory.*fewer episodes"):
        read_recording(path, arm(), columns=DEGREES)


def test_paths_in_the_description_lead_nowhere(tmp_path: Path) -> None:
    """Tables are found where they lie; places given in info.json are ignored."""
    path = two_episodes(tmp_path, together=True)
    described = json.loads((path / "meta" / "info.json").read_text())
    (path / "meta" / "info.json").write_text(json.dumps({**described, "data_path": "/etc/{episode_index}"}))
    assert len(read_recording(path, arm(), columns=DEGREES)) == 300


def test_tables_without_rows_are_refused_in_one_sentence(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "d", {"data/chunk-000/file-000.parquet": rows(0, 5, **motion(5)).head(0)})
    with refusal("d", "without rows"):
        FORMATS["lerobot"].open(folder)
