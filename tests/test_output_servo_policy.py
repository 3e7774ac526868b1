"""Names from robots, recordings and files in every page of position drives, in a real browser: text, never markup."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import polars as pl
import pytest
from chromium import Chromium
from senseless_servo import SWING, healthy
from test_output_report_policy import IMAGE, LINK, LOG, SCRIPT, SHOWN, check_harmless, show

from signid.cli import run

WINDOW = 800, 500  # [px] of the browser

ROOT = Path(__file__).parents[1]
ROBOT, BODY = "<svg onload=window.hit=3>", "<!--<script>"
PAGES = {name: f"{name}/report.html" for name in ("identify", "validate", "diagnose")} | {"replay": "replay.html"}


@pytest.fixture(scope="module", params=[IMAGE, LINK, SCRIPT], ids=["image", "link", "script"])
def place(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """A hostile name of a joint, and the folder with every page of its drive."""
    joint, folder = str(request.param), tmp_path_factory.mktemp("drives")
    text = (ROOT / "robots/1r/robot.urdf").read_text()
    for old, new in {"1r": ROBOT, "joint_1": joint, "link_1": BODY}.items():
        text = text.replace(f'"{old}"', quoteattr(new))
    arm = "<img src=x onerror=hit=4>.urdf"
    (folder / arm).write_text(text)
    numbers = "\n".join(f"{key} = {getattr(SWING, key)}" for key in ("kp", "kd", "delay"))
    (folder / "actuators.toml").write_text(f"[joint.1.servo]\n{numbers}\n")
    columns = healthy(1, seconds=5.0)
    pl.DataFrame({"t": columns["t"], f"q_{joint}": columns["q_1"], f"q_des_{joint}": columns["q_des_1"]}).write_csv(
        folder / LOG
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for verb in ("identify", "validate", "diagnose"):
            assert run([verb, arm, LOG, "-o", verb]) in (0, 3), verb
        assert run(["replay", arm, LOG, "--diagnosis", "diagnose/diagnosis.json", "--html", "replay.html"]) == 0
    yield joint, folder


@pytest.mark.slow_cases(but="script-identify")
@pytest.mark.parametrize("name", PAGES)
def test_names_are_text_in_every_page_of_drives(browser: Chromium, place: tuple[str, Path], name: str) -> None:
    joint, folder = place
    show(browser, folder / PAGES[name])
    check_harmless(browser)
    shown = browser.value(SHOWN)
    assert joint in shown and LOG in shown, shown[:500]
