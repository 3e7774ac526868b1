"""Files of factors that no recording could have given are refused in one sentence, although their hash is right."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signid
from signid.cli import run
from signid.errors import OptionError
from signid.regression.reduced import encode_factors, load_factors, reduce
from signid.regression.reduced.file import hash_of
from signid.types import Robot

Arrays, Header = dict[str, Any], dict[str, Any]
GRAM, COUNTS, WHOLE = "train_0_0_grams", "train_0_0_counts", "train_0_0_whole"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return signid.load_robot("1r")


@pytest.fixture(scope="module")
def content(robot: Robot) -> bytes:
    t = np.arange(0, 20, 0.01)
    angle = np.sin(t) + np.sin(2.3 * t)
    noise = np.random.default_rng(0).standard_normal(len(t))
    arrays = {"t": t, "q_1": angle, "tau_1": -0.5 * angle + 3 * np.sin(angle) + 0.1 * noise}
    return encode_factors(reduce(robot, [signid.read_recording(arrays, robot)]))


def rewritten(content: bytes, change: Callable[[Header, Arrays], object]) -> bytes:
    """The file with a change, and with the hash of its arrays."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = {name: archive[name].copy() for name in archive.files}
    header = json.loads(arrays.pop("header").tobytes())
    change(header, arrays)
    header["sha256"] = hash_of(arrays)
    file = io.BytesIO()
    np.savez(file, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)
    return file.getvalue()


def put(name: str, where: Any, what: float) -> Callable[[Header, Arrays], object]:
    return lambda _, arrays: arrays[name].__setitem__(where, what)


def scaled(name: str, by: float) -> Callable[[Header, Arrays], object]:
    return lambda _, arrays: arrays.update({name: arrays[name] * by})


def noise(name: str) -> Callable[[Header, Arrays], object]:
    return lambda _, arrays: arrays.update({name: np.random.default_rng(0).normal(size=arrays[name].shape)})


def header(*path: Any, to: Any) -> Callable[[Header, Arrays], object]:
    def change(found: Any, _: Arrays) -> None:
        for key in path[:-1]:
            found = found[key]
        found[path[-1]] = to

    return change


def integers(_: Header, arrays: Arrays) -> None:
    arrays["train_0_totals"] = arrays["train_0_totals"].astype(object).astype(str)


SENSELESS: dict[str, tuple[Callable[[Header, Arrays], object], str]] = {
    "a number that is not one": (put(GRAM, (0, 1, 1), np.nan), "not finite"),
    "an infinite count": (put(COUNTS, 0, np.inf), "not finite"),
    "a number beyond all motions": (put(WHOLE, (0, 0), 1e308), "not finite"),
    "random sums": (noise(GRAM), "not symmetric|semi-definite"),
    "not symmetric": (scaled("train_0_velocity", -1.0), "negative"),
    "one side of the sums": (put(GRAM, (0, 0, 1), 1e3), "not symmetric"),
    "not definite": (lambda _, x: x[GRAM][0].__setitem__((0, 0), 1e-9), "semi-definite"),
    "negative squares": (scaled(GRAM, -1.0), "negative"),
    "lagged sums beyond all rows": (put(GRAM, (2, 0, 0), 1e12), "lagged rows"),
    "negative counts": (scaled(COUNTS, -1.0), "counts"),
    "half a row": (put(COUNTS, 1, 10.5), "counts"),
    "more rows than there are": (put("train_0_totals", (0, 1), 1e9), "rows"),
    "rows without a number": (put("train_0_totals", (1, 1), np.nan), "number of rows"),
    "rows of a century": (put("train_0_totals", (1, 1), 1e300), "number of rows"),
    "a total beyond its rows": (put("train_0_totals", (0, 0), 1e20), "larger sums"),
    "rows that outweigh all rows": (scaled(WHOLE, 0.1), "larger sums"),
    "positions upside down": (put("train_0_lower", 0, 1e3), "lowest position"),
    "sampled rows of nothing": (put("train_0_sample_torque", (0, 0), np.nan), "sampled rows"),
    "a stride of three": (put("train_0_sample_stride", (), 3), "sampled rows"),
    "base parameters that are none": (noise("base_combination"), "base parameters"),
    "a parameter that does not exist": (put("base_independent", 0, 10**6), "base parameters"),
    "negative noise": (scaled("band_torque_floor", -1.0), "noise levels"),
    "an endless filter": (header("band", "factor", to=10**9), "filter"),
    "a rate of denormal size": (header("band", "rate", to=1e-310), "filter|shape|damaged"),
    "a position cut-off near zero": (header("band", "beyond", to=1e-300), "filter"),
    "endless reversals": (header("reach", 0, to=10**400), "reversals"),
    "an endless level": (header("sums", "train", 0, 1, to=10**400), "windows"),
    "levels below zero": (header("sums", "train", 0, 0, to=-1), "windows"),
    "part of no parts": (header("share", to=[5, 0]), "part 5 of 0"),
    "a law of another joint": (header("laws", 0, 1, to=[7]), "law"),
    "a law that is no word": (header("laws", 0, 0, to=None), "law"),
    "a law that is not linear": (header("laws", 0, 0, to="stribeck_friction"), "law"),
    "a law twice": (lambda found, _: found["laws"].append(found["laws"][0]), "law"),
    "a thousand laws": (lambda found, _: found["laws"].extend(found["laws"] * 1000), "law"),
    "notes that are no text": (header("notes", to=[{"a": 1}]), "no text"),
    "text in place of numbers": (integers, "damaged"),
}


@pytest.mark.parametrize("name", SENSELESS)
def test_senseless_factors_are_refused(name: str, robot: Robot, content: bytes, tmp_path: Path) -> None:
    change, words = SENSELESS[name]
    (tmp_path / "f.npz").write_bytes(rewritten(content, change))
    with pytest.raises(OptionError, match=words) as error:
        load_factors(tmp_path / "f.npz", robot)
    assert "f.npz" in str(error.value) and len(str(error.value)) < 300


def test_an_unchanged_file_is_read(robot: Robot, content: bytes, tmp_path: Path) -> None:
    (tmp_path / "f.npz").write_bytes(rewritten(content, lambda *_: None))
    assert encode_factors(load_factors(tmp_path / "f.npz", robot)) == content


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
def test_pipes_in_place_of_factors_are_refused_at_once(robot: Robot, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p.npz")
    with pytest.raises(OptionError, match="no regular file"):
        load_factors(tmp_path / "p.npz", robot)


def test_the_command_refuses_them_with_one_sentence(
    content: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "f.npz").write_bytes(rewritten(content, noise(GRAM)))
    assert run(["identify", "1r", str(tmp_path / "f.npz"), "--json"]) == 2
    said = capfd.readouterr()
    assert not said.out and len(said.err.splitlines()) == 1 and "reduce the recordings again" in said.err
