"""Curves of a joint in a replay, in a real browser; both robots side by side; labels on a phone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from chromium import Chromium
from diagnosis_file import write_diagnosis
from numpy.testing import assert_allclose

import signid
from signid.output.replay import Replay
from signid.output.replay.track import track_of

WINDOW = 900, 720  # [px] of the browser

ROOT = Path(__file__).parents[1]
LAWS = ("coulomb_friction@2:level=0.8", "payload:mass=0.3,first_moment_x=0.03")
VALUES = "[...document.querySelectorAll('#key span')].map(x => x.textContent)"
PAINTED = """['torque', 'position'].map(id => (c => new Set(new Uint32Array(c.getContext('2d')
  .getImageData(0, 0, c.width, c.height).data.buffer)).size)(document.getElementById(id)))"""
ENDS = """['recorded', 'simulated'].map(name => player.content.outline.map(point => {
  const moved = point.clone().add(name === 'recorded' ? point.clone().set(0, 0, 0) : player.stage.shift);
  const at = player.stage.screen({ group: player.stage.group([]), anchor: moved });
  return [at.x, at.y];
}))"""


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Replay:
    folder = tmp_path_factory.mktemp("curves")
    write_diagnosis(folder, "3r", LAWS)
    model = signid.load_model("3r")
    recording = signid.read_recording(ROOT / "robots/3r/recording.parquet", model.robot)
    return signid.replay(model, recording, folder / "diagnosis.json", duration=6)


@pytest.fixture(scope="module")
def address(shown: Replay, tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("page") / "replay.html"
    file.write_text(shown.page(), encoding="utf-8")
    return file.as_uri()


def numbers(text: str) -> list[float]:
    """Torque and position as printed: "1.23 N.m, −0.4 rad"."""
    return [float(part.split()[0].replace("\u2212", "-")) for part in text.split(", ")]


def expected(shown: Replay, frame: int, joint: int) -> list[list[float]]:
    """Torque and position at a frame: measured, of the original and of the extended simulation."""
    track = shown.track
    torque = [track.measured, *(track.measured - track.residual)]
    return [[x[frame, joint], q[frame, joint]] for x, q in zip(torque, [track.recorded, *track.simulated], strict=True)]


def test_the_measured_torque_is_that_of_the_recording() -> None:
    model = signid.load_model("3r")
    recording = signid.read_recording(ROOT / "robots/3r/recording.parquet", model.robot)
    samples = recording.read()
    track = track_of([model], recording, 0.5, 30.0)
    raw = np.column_stack([np.interp(track.t, samples.t, x) for x in samples.tau.T])
    known = np.isfinite(track.measured).all(axis=1)
    assert known.mean() > 0.95
    assert np.sqrt(np.mean((track.measured - raw)[known] ** 2)) < 0.1 * np.sqrt(np.mean(raw[known] ** 2))
    assert track.residual.shape == (1, *track.measured.shape)


@pytest.mark.slow
def test_the_curves_follow_slider_and_joint(browser: Chromium, address: str, shown: Replay) -> None:
    browser.open(f"{address}#joint=2&t=2", "window.player")
    assert not browser.value("document.querySelector('#curves').hidden"), "there is room for them"
    assert min(browser.value(PAINTED)) > 3, "several colours are drawn"
    for joint, t in ((1, 2.0), (1, 4.0), (2, 4.0)):
        browser.value(f"(s => {{ s.value = {joint}; s.dispatchEvent(new Event('change')) }})($('joint'))")
        browser.value(f"(s => {{ s.value = {t}; s.dispatchEvent(new Event('input')) }})($('time'))")
        texts = browser.value(VALUES)
        assert_allclose([numbers(text) for text in texts], expected(shown, round(30 * t), joint), rtol=6e-3, atol=1e-6)
        left = browser.value("[...document.querySelectorAll('.cursor')].map(x => x.getBoundingClientRect().x)")
        assert len(left) == 3 and max(left) - min(left) < 1, "one line through curves and strip"
    browser.click("#map", 0.25)
    assert browser.value("[$('joint').value, Math.abs(player.state.t - player.length / 4) < 0.1]") == ["1", True]
    browser.click("#shown label:nth-of-type(1)")
    assert browser.value("document.querySelector('#curves').hidden") and not browser.errors


@pytest.mark.slow
def test_labels_are_legible_on_a_phone_and_clear_of_the_robot(browser: Chromium, address: str) -> None:
    browser.send("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    browser.open(f"{address}#t=2", "window.player")
    browser.picture()
    sizes = "[...document.querySelectorAll('.label b, #names span, #key li, .axis span')]"
    assert min(browser.value(f"{sizes}.map(x => parseFloat(getComputedStyle(x).fontSize))")) >= 12
    low = browser.value(
        "Math.max(...[...document.querySelectorAll('.label')].map(x => x.getBoundingClientRect().bottom))"
    )
    assert low < min(y for _, y in browser.value(ENDS)[0]) + 5
    assert browser.value("document.documentElement.scrollWidth") <= 390
    long = Path(address.removeprefix("file://"))
    text = long.read_text(encoding="utf-8").replace('"name":"joint_', '"name":"left_arm_joint')
    long.with_name("long.html").write_text(text, encoding="utf-8")
    for page, cut in ((address, "joint_"), (long.with_name("long.html").as_uri(), "joint")):
        browser.open(page, "window.player")
        names = browser.value("[...document.querySelectorAll('#names span')].map(x => x.textContent)")
        assert names == [f"{cut}{j}" for j in (1, 2, 3)], "the ends of long names are shown"
