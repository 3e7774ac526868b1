"""The demonstration: output, files, reproducibility and reported misses."""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plant import law

import signid
from signid.cli import run
from signid.cli.demo import Story, demo
from signid.diagnose import Alternative
from signid.effects.naming import law_name
from signid.robot import load_robot

FILES = "demo.json diagnosis.json held_out.csv model.json recording.csv replay.html report.html robot.urdf".split()


@dataclass(frozen=True)
class Outcome:
    """Output of the command in a folder."""

    folder: Path
    code: int
    out: str
    err: str
    story: Story


def command(patch: pytest.MonkeyPatch, folder: Path, *arguments: str, story: Story | None = None) -> Outcome:
    """Run the command in a folder; a given story replaces a new one."""
    stories: list[Story] = []

    def play(*given: Any, **more: Any) -> Story:
        stories.append(demo(*given, **more) if story is None else story)
        return stories[-1]

    patch.chdir(folder)
    patch.setenv("COLUMNS", "100")
    patch.setattr(sys.modules["signid.cli.demo"], "demo", play)
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        code = run(["demo", *arguments])
    return Outcome(folder, code, out.getvalue(), err.getvalue(), stories[0])


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Outcome]:
    """The story of the 3R arm."""
    with pytest.MonkeyPatch.context() as patch:
        yield command(patch, tmp_path_factory.mktemp("demo"))


def test_concealed_laws_are_found_and_proved(shown: Outcome) -> None:
    story, result = shown.story, shown.story.result
    assert [outcome.kind for outcome in story.outcomes] == ["found"] * 3
    assert result.verdict == "named" and len(result.causes) == 3 and story.flags == ()
    for outcome in story.outcomes:
        found = outcome.found
        assert found is not None and found.probability > 0.99
        for key, value in outcome.law.parameters.items():
            assert abs(found.law.parameters[key] - value) < 4 * found.std[key], key
    before, after = result.rollout_before, result.rollout_after
    assert before is not None and after is not None
    assert np.all(result.gain < 0.2) and np.all(after.rms(0.5) < 0.2 * before.rms(0.5))


def test_the_diagnosis_is_printed_and_compared_with_the_truth(shown: Outcome) -> None:
    lines = shown.out.splitlines()
    assert (shown.code, shown.err) == (0, "") and len(lines) <= 60 and max(map(len, lines)) <= 100
    compared = lines[lines.index("Concealed and found laws, ± 95 %") :]
    for outcome in shown.story.outcomes:
        row = next(line for line in compared if line.startswith(law_name(outcome.law, shown.story.simulation.robot)))
        assert row.rstrip().endswith("found")
    assert "  signid-demo/report.html\n  signid-demo/replay.html\n" in shown.out
    assert sorted(path.name for path in (shown.folder / "signid-demo").iterdir()) == FILES


def test_the_files_say_the_same(shown: Outcome) -> None:
    folder, result = shown.folder / "signid-demo", shown.story.result
    said, found = (json.loads((folder / name).read_text()) for name in ("demo.json", "diagnosis.json"))
    assert said["schema"] == "signid.demo/1" and said["robot"] == "3r" and said["flags"] == []
    assert all(said[key] == found[key] for key in ("verdict", "fit", "rollout", "inputs", "seed", "version"))
    for entry in said["concealed"]:
        named = next(f for f in found["findings"] if (f["effect"], f["joint"]) == (entry["effect"], entry["joint"]))
        assert entry["outcome"] == "found" and entry["probability"] == named["probability"]
        for key, number in entry["parameters"].items():
            theirs = {"found": named["parameters"][key]["value"], "std": named["parameters"][key]["std"]}
            assert {**number, **theirs} == number and number["unit"] == named["parameters"][key]["unit"]
    extended = signid.load_model(folder / "model.json")
    assert len(extended.laws) == len(result.model.laws) == 3, "and nothing beside them"
    assert "spring" in (folder / "replay.html").read_text() and "spring" in (folder / "report.html").read_text()


@pytest.mark.slow
def test_by_hand_the_diagnosis_is_the_same(
    shown: Outcome, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The command reads the description and the two files only."""
    monkeypatch.chdir(shown.folder)
    line = next(line for line in shown.out.splitlines() if line.startswith("again: "))
    assert run([*line.split()[2:], "--json"]) == 0
    again, first = json.loads(capfd.readouterr().out), json.loads(Path("signid-demo/diagnosis.json").read_text())
    assert again == first


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(shown: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    again = command(monkeypatch, tmp_path, "--robot", "3r", "--json")
    assert (again.code, again.err) == (0, "")
    for name in FILES:
        theirs = shown.folder / "signid-demo" / name
        assert (tmp_path / "signid-demo" / name).read_bytes() == theirs.read_bytes(), name
    assert again.out == (tmp_path / "signid-demo" / "demo.json").read_text()


def test_pages_open_only_on_a_terminal(shown: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(Path(url).name))
    for name in ("WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    for screen, more, pages in ((":0", (), 2), (":0", ("--no-open",), 0), (":0", ("--json",), 0), ("", (), 0)):
        monkeypatch.setenv("DISPLAY", screen)
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(io, "StringIO", Terminal)
        command(monkeypatch, tmp_path, *more, story=shown.story)
        assert opened == ["report.html", "replay.html"][:pages], (screen, more)
        opened.clear()
    monkeypatch.undo()


def test_a_miss_is_reported(shown: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    story = shown.story
    first, second, third = story.result.findings
    robot, other = story.simulation.robot, law("armature", 2, inertia=0.1)
    beside = replace(second, law=other, alternatives=(Alternative(second.law, 0.25, ""),))
    wrong = replace(story, result=replace(story.result, findings=(first, beside, replace(third, role="secondary"))))
    found = command(monkeypatch, tmp_path, story=wrong)
    hidden = law_name(second.law, robot)
    flag = f"{hidden} was concealed and named only as an alternative to armature of joint_3, with probability 0.250"
    assert found.code == 3 and wrong.flags == (flag,)
    assert flag in found.err and "only an alternative" in found.out
    assert f"{third.law.effect.name} of" in found.out and "found, as a correction" in found.out
    another = replace(second, law=other, alternatives=())
    wrong = replace(story, result=replace(story.result, findings=(first, another, third)))
    gone = command(monkeypatch, tmp_path, story=wrong)
    assert wrong.flags == (
        f"{hidden} was concealed and missed",
        "armature of joint_3 was named but not concealed",
    )
    assert gone.code == 3 and all(flag in gone.err for flag in wrong.flags) and "missed" in gone.out
    entry = next(e for e in json.loads(Path("signid-demo/demo.json").read_text())["concealed"] if not e["probability"])
    assert entry["outcome"] == "missed" and all(n["found"] is None for n in entry["parameters"].values())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--robot", "nobody"], "there is no file and no robot named 'nobody'"),
        (["-o", "taken/below"], "taken is a file"),
        (["-o", ""], "no folder"),
        (["--seed", "-1"], "--seed"),
    ],
)
def test_bad_input_is_refused(
    arguments: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("")
    assert run(["demo", *arguments]) == 2
    out, err = capfd.readouterr()
    assert out == "" and err.startswith("signid: ") and says in err and err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


@pytest.mark.slow
def test_an_interrupted_demonstration_can_be_repeated(
    shown: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["signid.cli.demo"], "diagnose", interrupted)
        assert run(["demo", "--no-open"]) == 130 and not list(tmp_path.iterdir())
    replace_file, folder = os.replace, tmp_path / "signid-demo"

    def replaced_until(count: int) -> Any:
        def replaced(*paths: Any) -> None:
            nonlocal count
            count -= 1
            if count < 0:
                raise KeyboardInterrupt
            replace_file(*paths)

        return replaced

    for count in range(len(FILES)):
        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", replaced_until(count))
            patch.setattr(sys.modules["signid.cli.demo"], "demo", lambda *_, **__: shown.story)
            assert run(["demo", "--no-open"]) == 130
            assert len(list(folder.glob("*"))) == count if folder.exists() else count == 0
        again = command(monkeypatch, tmp_path, "--no-open", story=shown.story)
        assert again.code == 0 and sorted(path.name for path in folder.iterdir()) == FILES
        shutil.rmtree(folder)


@pytest.mark.slow
def test_progress_goes_forward(tmp_path: Path) -> None:
    shares: list[float] = []
    demo(load_robot("1r"), tmp_path, progress=lambda what, share: shares.append(share))
    assert shares == sorted(shares) and shares[0] == 0 and shares[-1] < 1 and len(shares) > 4


@pytest.mark.slow
def test_the_panda_has_a_demonstration(tmp_path: Path) -> None:
    story = demo(load_robot("panda"), tmp_path)
    assert [outcome.kind for outcome in story.outcomes] == ["found"] * 3 and story.flags == ()
    assert np.all(story.result.gain[:6] < 0.2) and len(story.simulation.robot.joints) == 7
