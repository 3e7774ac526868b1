"""The command `signid validate`."""

from __future__ import annotations

import shutil
from hashlib import sha256
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from strict_json import strict

import signid
from signid.cli import run

pytestmark = pytest.mark.usefixtures("inside")

EXAMPLES = Path(__file__).parents[1] / "robots" / "3r"
MODELS = ["3r", "id/model.json"]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings of an arm, and a model identified from one of them."""
    folder = tmp_path_factory.mktemp("validate")
    for name in ("recording", "held_out"):
        shutil.copy(EXAMPLES / f"{name}.parquet", folder)
    assert run(["identify", "3r", str(folder / "recording.parquet"), "-o", str(folder / "id")]) == 0
    return folder


def printed(capfd: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> Any:
    capfd.readouterr()
    assert run(["validate", *arguments, "--json"]) == code
    return strict(capfd.readouterr().out)


def test_the_document_has_the_fields_of_the_contract(capfd: pytest.CaptureFixture[str]) -> None:
    found = printed(capfd, *MODELS, "held_out.parquet")
    assert found["schema"] == "signid.validation/1" and (found["seed"], found["version"]) == (0, signid.__version__)
    assert [one["path"] for one in found["models"]] == MODELS
    for one in found["models"]:
        fit, rolled = one["fit"], one["rollout"]
        keys = {"joints", "unit", "train_rms", "held_out_rms", "noise_floor", "held_out_r2"}
        assert set(fit) == keys and fit["train_rms"] is None
        assert fit["joints"] == ["joint_1", "joint_2", "joint_3"] and fit["unit"] == ["N.m"] * 3
        assert all(len(fit[key]) == 3 for key in keys - {"train_rms"})
        assert set(rolled) == {"horizon", "rms", "unit"} and rolled["horizon"] == 0.5 and rolled["unit"] == ["rad"] * 3
        assert all(x > 0 for x in rolled["rms"])
    assert found["models"][0]["fit"]["noise_floor"] == found["models"][1]["fit"]["noise_floor"]
    files = {entry["path"]: entry["sha256"] for entry in found["inputs"]}
    assert set(files) == {"held_out.parquet", *MODELS}
    assert all(files[name] == sha256(Path(name).read_bytes()).hexdigest() for name in ("held_out.parquet", MODELS[1]))


def test_figures_are_those_of_the_library(capfd: pytest.CaptureFixture[str]) -> None:
    robot = signid.load_robot("3r")
    models = [signid.load_model(name) for name in MODELS]
    given = signid.validate(models, signid.read_recording("held_out.parquet", robot))
    for one, shown in zip(given.models, printed(capfd, *MODELS, "held_out.parquet")["models"], strict=True):
        assert shown["fit"]["held_out_rms"] == one.fit.held_out_rms.tolist()
        assert shown["fit"]["held_out_r2"] == one.fit.held_out_r2.tolist()
        assert one.rollout is not None and shown["rollout"]["rms"] == one.rollout.rms(0.5).tolist()


def test_files_are_complete_and_the_same_every_time(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for name in ("one", "two"):
        capfd.readouterr()
        assert run(["validate", *MODELS, "held_out.parquet", "-o", name, "--json", "--seed", "4"]) == 0
        assert capfd.readouterr().out == Path(name, "validation.json").read_text()
        assert sorted(path.name for path in Path(name).iterdir()) == ["report.html", "validation.json"]
    for name in ("validation.json", "report.html"):
        assert Path("one", name).read_bytes() == Path("two", name).read_bytes(), name
    assert run(["validate", *MODELS, "missing.csv", "-o", "three"]) == 2
    assert not Path("three").exists()


def test_options_reach_the_library(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    table = pl.read_parquet("held_out.parquet")
    names = {name: f"{name}_own" for name in table.columns if name != "t"}
    table.rename(names).write_parquet("own.parquet")
    (place / "map.toml").write_text("".join(f'{name} = "{own}"\n' for name, own in names.items()))
    (place / "drive.toml").write_text("[joint.1]\ncoulomb_friction = 1.0\nviscous_friction = 1.0\n")
    plain = printed(capfd, *MODELS, "held_out.parquet", "--cutoff", "9")
    assert plain["cutoff"]["torque"] == pytest.approx(9, rel=0.1)
    mapped = printed(capfd, *MODELS, "own.parquet", "--cutoff", "9", "--columns", "map.toml")
    assert mapped["models"] == plain["models"] and "map.toml" in [entry["path"] for entry in mapped["inputs"]]
    driven = printed(capfd, *MODELS, "held_out.parquet", "--cutoff", "9", "--actuators", "drive.toml", "--no-rollout")
    before, after = (found["models"][0]["fit"]["held_out_rms"] for found in (plain, driven))
    assert after[0] < 0.9 * before[0] and after[1:] == before[1:]
    assert driven["models"][1]["fit"] == plain["models"][1]["fit"] and driven["models"][1]["rollout"] is None
    locked = printed(capfd, *MODELS, "held_out.parquet", "--lock", "joint_3=0", code=3)
    assert locked["models"][0]["fit"]["joints"] == ["joint_1", "joint_2"] and len(locked["flags"]) == 1


def test_a_recording_fault_is_a_flag(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pl.read_parquet("held_out.parquet").with_columns(-pl.col("tau_2")).write_parquet("negated.parquet")
    found = printed(capfd, *MODELS, "negated.parquet", "--no-rollout", code=3)
    assert len(found["flags"]) == 1 and "the torque of joint_2 has the wrong sign" in found["flags"][0]
    assert run(["validate", *MODELS, "negated.parquet", "--no-rollout"]) == 3
    assert "the torque of joint_2 has the wrong sign" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("3r", "no recording was given with 3r"),
        ("held_out.parquet", "no model was given with held_out.parquet"),
        ("3r 3r held_out.parquet", "3r was given twice"),
        ("3r nothing.csv", "nothing.csv does not exist"),
        ("nobody held_out.parquet", "nobody is neither a model nor a recording"),
        ("nothing.json held_out.parquet", "cannot read nothing.json"),
        ("id/identification.json held_out.parquet", "has the schema 'signid.identification/1'; give a model.json"),
        ("id held_out.parquet", "the folder id holds model.json and robot.urdf; name the file instead"),
        ("empty held_out.parquet", "the folder empty holds neither a model nor a recording"),
        ("3r notes.doc", "notes.doc has the name of neither a model nor a recording"),
        ("3r signless.parquet", "signless.parquet has no sign of the torque of joint_1, joint_2, joint_3"),
        ("3r panda held_out.parquet", "3r moves joint_1, joint_2, joint_3, the recordings panda_joint1"),
        ("id/model.json held_out.parquet --lock joint_1=0", "states its joints and actuators itself"),
        ("3r held_out.parquet --cutoff -1", "a positive frequency is needed"),
        ("3r held_out.parquet -o notes.txt", "notes.txt is a file"),
        ("3r held_out.parquet -o ''", "no folder for the results was named"),
    ],
)
def test_bad_input_gives_one_sentence(command: str, words: str, place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (place / "empty").mkdir(exist_ok=True)
    (place / "notes.txt").write_text("no samples\n")
    (place / "notes.doc").write_text("no samples\n")
    table = pl.read_parquet("held_out.parquet")
    lost = {name: f"abs_{name}" for name in table.columns if name.startswith("tau_")}
    table.with_columns(pl.col(*lost).abs()).rename(lost).write_parquet("signless.parquet")
    before = sorted(place.rglob("*"))
    assert run(["validate", *(word.strip("'") for word in command.split())]) == 2
    out, err = capfd.readouterr()
    assert words in err and len(err.splitlines()) == 1 and not out
    assert sorted(place.rglob("*")) == before
