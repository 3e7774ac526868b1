"""Names from robots, recordings, files and manifests in every page, in a real browser: text, never markup or script."""

from __future__ import annotations

import csv
import gzip
import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import polars as pl
import pytest
from chromium import Chromium

import signid
from signid.cli import run
from signid.cli.fleet import run as run_module
from signid.cli.fleet.run import DONE, Answer, Order, fleet
from signid.output.replay import Replay
from signid.output.report.layout import content_policy, plot_markup
from signid.output.report.pages import PLOTLY_FILE, TEMPLATES
from signid.output.report.results.fleet import fleet_page
from signid.output.report.sections import Plot

WINDOW = 800, 500  # [px] of the browser

ROOT = Path(__file__).parents[1]
IMAGE = '"><img src=x onerror=window.hit=1>'
LINK = "<a href='https://example.com/' style='color:red'>go</a>"
SCRIPT = "</script><script>window.hit=2</script>"
JOINTS = (IMAGE, LINK, SCRIPT)
NAMES = {
    "3r": "<svg onload=window.hit=3>",
    **dict(zip(("joint_1", "joint_2", "joint_3"), JOINTS, strict=True)),
    "link_1": "<!--<script>",
    "link_2": "<iframe src=https://example.com/></iframe>",
    "link_3": "<b>bold</b> %{y} &lt;i&gt; ${link}",
}
ARM, LOG = "<img src=x onerror=hit=4>.urdf", "<b>x<img src=x onerror=hit=5>.csv"
UNIT = "<b>%{x}</b>"
MADE = (
    "img, iframe, marquee, [onload], [onerror], [src], a:not([href^='sessions/']), tspan[style]"  # never signid's own
)
BOLD = "[...document.querySelectorAll('b, i')].filter(x => x.textContent.trim() === 'bold').length"
DRAW = "(document.querySelectorAll('details').forEach(x => x.open = true), 0)"
DRAWN = "[...document.querySelectorAll('.plot')].every(x => x.querySelector('.main-svg'))"
SHOWN = "document.body.innerText + [...document.querySelectorAll('svg text')].map(x => x.textContent).join('\\n')"
HOVERED = """(point => {
  const box = [...document.querySelectorAll('.plot')].find(x => x.data.some(y => y.type === point[0]));
  Plotly.Fx.hover(box, [point[1]]);
  return [...box.querySelectorAll('.hovertext text')].map(x => x.textContent).join('\\n');
})"""
HOVER = {
    "diagnosis": ("heatmap", {"xval": 5, "yval": 1}, LINK),
    "signs": ("bar", {"curveNumber": 0, "pointNumber": 0}, "confidence >0.999"),
}
PAGES = ("check", "identification", "signs", "validation", "diagnosis", "fleet", "replay")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Every page of a robot and a recording with hostile names."""
    place = tmp_path_factory.mktemp("hostile")
    text = (ROOT / "robots/3r/robot.urdf").read_text()
    for old, new in NAMES.items():
        text = text.replace(f'"{old}"', quoteattr(new))
    (place / ARM).write_text(text)
    rows = pl.read_parquet(ROOT / "robots/3r/recording.parquet")[:1200]
    named = {f"{key}_{j + 1}": f"{key}_{name}" for j, name in enumerate(JOINTS) for key in ("q", "tau")}
    rows.rename(named).write_csv(place / LOG)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for verb in (["check"], ["identify"], ["identify", "--unsigned"], ["validate"], ["diagnose"]):
            assert run([*verb, ARM, LOG, "-o", verb[-1]]) in (0, 3), verb
        assert run(["replay", ARM, LOG, "--diagnosis", "diagnose/diagnosis.json", "--html", "replay.html"]) == 0
        _fleet(patch)
    yield place


def _fleet(patch: pytest.MonkeyPatch) -> None:
    """The page of a fleet of sessions that drift, and of one that failed."""
    rows = [[ARM, LOG, SCRIPT, f"2026-0{k + 1}-01", "diagnose", f"s{k}"] for k in range(6)]
    rows.append([ARM, LOG, IMAGE, "2026-01-01", "identify", "failed"])
    with Path("<b>fleet.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["robot", "recording", "name", "time", "task", "session"], *rows])

    def answer(orders: Sequence[Order], *_: object) -> Iterator[tuple[int, Answer]]:
        for k in range(len(orders) - 1):
            document = json.loads(Path("diagnose/diagnosis.json").read_text())
            for finding in document["findings"]:
                for number in finding["parameters"].values():
                    number.update(value=1.0 + k, std=0.01, unit=UNIT)
            yield k, Answer(DONE, (), {"diagnosis.json": json.dumps(document).encode(), "report.html": b""})
        yield len(orders) - 1, Answer(2, (f"{LINK} is no file",), {})

    patch.setattr(run_module, "spread", answer)
    Path("fleet.html").write_text(fleet_page(fleet("<b>fleet.csv", "out").document(), f"signid fleet {IMAGE}"))


def path(folder: Path, name: str) -> Path:
    """File of a page."""
    places = {"identification": "identify/report.html", "signs": "--unsigned/signs.html", "fleet": "fleet.html"}
    places |= {"check": "check/report.html", "validation": "validate/report.html", "replay": "replay.html"}
    return folder / places.get(name, "diagnose/report.html")


def show(browser: Chromium, page: Path) -> None:
    """Open a page with all that is folded."""
    browser.open(page.as_uri(), "window.player || window.Plotly")
    browser.value(DRAW)
    browser.until(DRAWN)


def check_harmless(browser: Chromium) -> None:
    """No name became an element, ran, or asked for anything."""
    assert browser.value(f"[...document.querySelectorAll({json.dumps(MADE)})].map(x => x.outerHTML)") == []
    assert browser.value(BOLD) == 0 and browser.value("typeof window.hit") == "undefined"
    assert all(url.startswith(("file:", "data:", "blob:")) for url in browser.requests), browser.requests
    assert browser.errors == [], "nothing was tried that the policy refuses"


@pytest.mark.slow_cases("signs|validation|diagnosis|^check")
@pytest.mark.parametrize("name", PAGES)
def test_names_are_text_in_every_page(browser: Chromium, folder: Path, name: str) -> None:
    show(browser, path(folder, name))
    check_harmless(browser)
    shown = browser.value(SHOWN)
    for text in (*JOINTS, *([] if name == "signs" else [LOG])):
        assert text in shown, text
    if name == "identification":
        assert NAMES["link_3"] in shown and NAMES["3r"] in shown and NAMES["link_1"] in shown
    if name in HOVER:
        text = browser.value(f"{HOVERED}({json.dumps(HOVER[name])})")
        assert HOVER[name][2] in text and "extra" not in text and not re.search("&\\w+;|&#", text)
        check_harmless(browser)


@pytest.mark.slow_cases("replay")
@pytest.mark.parametrize("name", ["fleet", "replay"])
def test_the_policy_stops_a_page_that_was_tampered_with(browser: Chromium, folder: Path, name: str) -> None:
    """Were a name ever not escaped, the browser would neither run nor load anything."""
    text = path(folder, name).read_text(encoding="utf-8")
    assert "unsafe-eval" not in text[:4096] and "script-src 'sha256-" in text[:4096] and "<script" not in text[:500]
    slipped = "<script>window.hit=6</script><img src='https://example.com/a.png' onerror=window.hit=7>"
    slipped += "<base href='https://example.com/'><iframe src='https://example.com/'></iframe><p id=slipped></p>"
    page = folder / f"tampered_{name}.html"
    page.write_text(re.sub("<body[^>]*>", lambda tag: tag[0] + slipped, text, count=1), encoding="utf-8")
    browser.requests.clear(), browser.errors.clear()
    browser.send("Page.navigate", url=page.as_uri())
    refused = "Content Security Policy"
    for _ in range(200):
        if browser.value("!!document.querySelector('#slipped') && document.readyState === 'complete'"):
            break
    assert sum(refused in error for error in browser.errors) >= 3, browser.errors
    assert browser.value("typeof window.hit") == "undefined" and browser.value("document.baseURI").startswith("file:")


def test_a_replay_shows_bodies_with_names_of_javascript(browser: Chromium, folder: Path) -> None:
    text = (ROOT / "robots/3r/robot.urdf").read_text()
    for old, new in zip(("joint_1", "joint_2", "joint_3"), ("constructor", "__proto__", "toString"), strict=True):
        text = text.replace(f'"{old}"', f'"{new}"')
    (folder / "words.urdf").write_text(text)
    model = signid.load_model(folder / "words.urdf")
    shown: Replay = signid.replay(
        model, signid.read_recording(ROOT / "robots/3r/recording.parquet", model.robot), duration=2
    )
    (folder / "words.html").write_text(shown.page(), encoding="utf-8")
    browser.open((folder / "words.html").as_uri(), "window.player")
    assert browser.value("player.stage.recorded.length") == 3 and browser.errors == []


def test_the_script_of_plots_is_that_of_its_publisher() -> None:
    """npm pack plotly.js-cartesian-dist-min@4.1.1"""
    script = gzip.decompress((TEMPLATES / PLOTLY_FILE).read_bytes())
    assert b"(cartesian - minified) v4.1.1" in script[:100]
    assert hashlib.sha256(script).hexdigest() == "79542150855a52c567260e3137095dbe2b744e6d702a5cabe67da246942fba7a"


def test_plots_escape_all_but_their_own_markup() -> None:
    own = plot_markup("$name: %{y} $unit<br><extra></extra>", name="<b>&amp;", unit="%{x}")
    plot = Plot("<p>", [{"y": [IMAGE, "%{z}"], "hovertemplate": own, "n": 1}], {"xaxis": {"title": {"text": LINK}}})
    drawn = json.loads(plot.text)
    assert drawn["data"][0]["hovertemplate"] == "&lt;b&gt;&amp;amp;: %{y} &#37;{x}<br><extra></extra>"
    assert drawn["data"][0]["y"] == ['"&gt;&lt;img src=x onerror=window.hit=1&gt;', "&#37;{z}"]
    assert drawn["layout"]["xaxis"]["title"]["text"].startswith("&lt;a href='https://example.com/'")
    assert "<" not in plot.text, "the JSON stands inside a script element"


def test_the_policy_names_scripts_as_a_browser_reads_them() -> None:
    assert content_policy(["a\r\nb"]) == content_policy(["a\nb"]) != content_policy(["a b"])
    assert "'sha256-YbRhp3ZV7PXTN6Os+FfZy63zkZr1zAo4LZYdbywC6rg='" not in content_policy(["alert(2)"])
