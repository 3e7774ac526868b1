"""The replay in a real browser: drawing, ghost and controls work offline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from chromium import Chromium, Picture, changed
from diagnosis_file import write_diagnosis

import signid
from signid.cli import run
from signid.output.replay import Replay

READY = "window.player"
AREA = slice(60, 560), slice(320, 700)  # of the window: clear of cards, switches and labels
LAWS = (
    "coulomb_friction@2:level=0.8",
    "payload:mass=0.3,first_moment_x=0.03",
    "external_contact:force_x=0,force_y=0,force_z=6,start=2,end=3",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of an arm with physics that the description lacks, and a diagnosis that names all of it."""
    place = tmp_path_factory.mktemp("replay")
    made = [word for law in LAWS for word in ("--inject", law)]
    sensors = "--noise 0.01 --encoder-bits 17 --seed 3 --duration 8".split()
    assert run(["simulate", "3r", *made, *sensors, "-o", str(place / "arm.csv")]) == 0
    write_diagnosis(place, "3r", LAWS)
    return place


@pytest.fixture(scope="module")
def shown(folder: Path) -> Replay:
    model = signid.load_model("3r")
    recording = signid.read_recording(folder / "arm.csv", model.robot)
    return signid.replay(model, recording, folder / "diagnosis.json")


@pytest.fixture(scope="module")
def address(folder: Path, shown: Replay) -> str:
    (folder / "replay.html").write_text(shown.page(), encoding="utf-8")
    return (folder / "replay.html").as_uri()


@pytest.fixture
def page(browser: Chromium, address: str) -> Chromium:
    """The page, freshly opened in the middle of a roll-out."""
    browser.open(f"{address}#t=4.4", READY)
    return browser


def greenish(picture: Picture) -> int:
    red, green, blue = np.moveaxis(picture[AREA], 2, 0)
    return int(((green > red + 20) & (green > blue)).sum())


def test_both_robots_are_drawn_and_nothing_is_fetched(page: Chromium) -> None:
    both = page.picture()
    assert len(np.unique(both[AREA].reshape(-1, 3), axis=0)) > 500
    page.click("#show-recorded")
    ghost = page.picture()
    page.click("#show-simulated")
    none = page.picture()
    assert changed(AREA, both, none) > 3000, "robots fill part of the picture"
    assert greenish(ghost) > 1500 and greenish(none) == 0
    assert changed(AREA, both, ghost) > 1500
    assert not page.errors
    assert page.requests and {url.partition(":")[0] for url in page.requests} <= {"file", "data", "blob"}
    assert page.value("document.querySelector('#readout').textContent").startswith("robots up to ")
    apart = "player.stage.recorded.map((g, k) => g.position.distanceTo(player.stage.simulated[k].position))"
    assert max(page.value(apart)) > 0.005
    restarts = page.value(
        "[...player.content.window].findIndex((w, k, all) => k && w !== all[k - 1] && all[k - 1] >= 0)"
    )
    page.value(f"player.seek({restarts} * player.content.period)")
    assert max(page.value(apart)) < 0.005, "a roll-out starts from the measured state"


@pytest.mark.slow
def test_the_slider_and_the_strip_move_time(page: Chromium) -> None:
    first = page.picture()
    page.click("#time", 0.8)
    assert page.value("player.state.t") == pytest.approx(0.8 * page.value("player.length"), abs=0.15)
    second = page.picture()
    assert changed(AREA, first, second) > 1000
    assert page.value("document.querySelector('#clock').textContent").startswith("6.")
    page.click("#map", 0.25)
    assert page.value("player.state.t") == pytest.approx(0.25 * page.value("player.length"), abs=0.05)
    assert changed(AREA, second, page.picture()) > 1000


@pytest.mark.slow
def test_it_plays_pauses_and_has_speeds(page: Chromium) -> None:
    page.value("player.seek(0)")
    page.click("#play")
    page.until("player.state.t > 0.3")
    page.click("#play")
    stopped = page.value("player.state.t")
    page.picture()
    assert page.value("player.state.t") == stopped
    page.value("(s => { s.value = '4'; s.dispatchEvent(new Event('change')) })(document.querySelector('#speed'))")
    assert page.value("player.state.speed") == 4
    page.value("document.querySelector('#play').click()")
    page.until("!player.state.playing && player.state.t === player.length")


@pytest.mark.slow
def test_before_and_after_and_side_by_side(page: Chromium, shown: Replay) -> None:
    apart = (
        "Math.max(...player.stage.recorded.map((g, k) => g.position.distanceTo(player.stage.simulated[k].position)))"
    )
    before, given = page.value(apart), page.picture()
    page.click("#model label:nth-of-type(2)")
    assert page.value(apart) < 0.3 * before and changed(AREA, given, page.picture()) > 300
    error = np.nanmean(np.abs(shown.simulated[:, ..., :3] - shown.recorded[None, ..., :3]), axis=(1, 2, 3))
    assert error[1] < 0.3 * error[0]
    seen = page.picture()
    page.click("#layout label:nth-of-type(2)")
    assert changed(AREA, seen, page.picture()) > 1000
    assert page.value("player.stage.shift.length()") > 0.2
    ends = "document.querySelector('#scale div').textContent"
    assert page.value(ends).endswith("N.m")
    page.click("#colour label:nth-of-type(2)")
    assert page.value(ends).endswith("%")


def test_links_are_coloured_and_findings_marked_at_their_place(page: Chromium) -> None:
    meant = (
        "residualColour(residualAt(player.content, player.state, b.joint, 132) / colourEnd(player.content, b.joint))"
    )
    drawn = "player.stage.recorded[k].userData.material.color.toArray()"
    colours = page.value(f"player.content.bodies.flatMap((b, k) => b.joint < 0 ? [] : [[{drawn}, {meant}]])")
    assert len(colours) == 3
    for drawn, meant in colours:
        np.testing.assert_allclose(255 * np.array(drawn), meant, atol=1)
    titles = page.value("[...document.querySelectorAll('.label b')].map(b => b.textContent)")
    words = ["A payload of 0.300 ± 0.002 kg", "An external contact from 2.00 s to 3.00 s: 6.000 ± 0.002 N"]
    assert sorted(titles) == [*words, "Coulomb friction of joint_2: 0.800 ± 0.002 N.m"]
    verdict = page.value("document.querySelector('#verdict').textContent")
    assert verdict.startswith("The simulation lacks ") and all(title[1:] in verdict for title in titles)
    kinds = page.value("player.stage.marks.map(m => [m.mark.kind, m.group.visible, m.group.children.length])")
    assert sorted(kinds) == [["body", True, 1], ["force", False, 2], ["joint", True, 1]], "no contact at 4.4 s"
    page.value("player.seek(2.5)")
    assert page.value("player.stage.marks.every(m => m.group.visible)")
    ring = "player.stage.marks.find(m => m.mark.kind === 'joint').group.position"
    joint = "player.stage.recorded[player.content.bodies.findIndex(b => b.name === 'joint_2')].position"
    assert page.value(f"{ring}.distanceTo({joint})") == 0
    spots = page.value(
        "player.labels.map(l => (r => [r.left, r.top, r.right, r.bottom])(l.label.getBoundingClientRect()))"
    )
    assert all(0 <= left < right <= 1000 and 0 <= top < bottom <= 700 for left, top, right, bottom in spots)


@pytest.mark.slow_cases(but="1000-330")
@pytest.mark.parametrize(("width", "height", "crowded"), [(1000, 700, False), (1000, 330, True), (390, 560, True)])
def test_labels_without_room_are_counted_and_named(
    browser: Chromium, address: str, width: int, height: int, crowded: bool
) -> None:
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.send("Emulation.setDeviceMetricsOverride", **size)
    try:
        browser.open(f"{address}#t=2.5", READY)
        browser.until("player.labels.every(l => l.label.style.visibility)")
        hidden = browser.value(
            "player.labels.filter(l => l.label.style.visibility === 'hidden').map(l => l.mark.mark.title)"
        )
        assert bool(hidden) == crowded
        box = "document.querySelector('#unlabelled')"
        assert browser.value(f"{box}.style.visibility") == ("visible" if crowded else "hidden")
        assert browser.value(f"{box}.textContent") == f"and {len(hidden)} more"
        assert browser.value("document.querySelector('#others').textContent") == f"not labelled: {'; '.join(hidden)}"
        edges = f"(r => [r.left, innerWidth - r.right, r.top, innerHeight - r.bottom])({box}.getBoundingClientRect())"
        assert not crowded or min(browser.value(edges)) >= 0
    finally:
        browser.send("Emulation.setDeviceMetricsOverride", **{**size, "width": 1000, "height": 700})


@pytest.mark.slow
def test_live_it_is_a_meshcat_viewer(browser: Chromium, shown: Replay, capfd: pytest.CaptureFixture[str]) -> None:
    meshcat = pytest.importorskip("meshcat")
    live = shown.show()
    try:
        browser.open(live.url, READY)
        assert capfd.readouterr() == ("", "")
        viewer = meshcat.Visualizer(zmq_url=live.zmq_url)
        viewer.wait()
        alone = browser.picture()
        viewer["elsewhere/ball"].set_object(meshcat.geometry.Sphere(0.3))
        browser.until(
            "player.stage.viewer.scene_tree.find(['meshcat', 'elsewhere', 'ball']).object.children.length > 0"
        )
        assert changed(AREA, alone, browser.picture()) > 500 and not browser.errors
        assert all(url.startswith((live.url, "data:", "blob:")) for url in browser.requests)
    finally:
        live.close()
