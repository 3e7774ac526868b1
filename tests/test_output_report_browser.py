"""Reports in a real browser without a network: wide, on a phone, in the dark and on paper."""

from __future__ import annotations

from pathlib import Path

import pytest
from chromium import Chromium
from example import notebook, unsigned
from servo_logs import drive, recording
from servo_results import invented
from test_output_report_diagnosis import made

import signid
from signid.faults.commands import audit_servos
from signid.output.report.results.check import audit_page, check_page
from signid.output.report.results.diagnosis import diagnosis_page
from signid.output.report.results.identification import identification_page
from signid.output.report.results.validation import validation_page

WINDOW = 1200, 900  # [px] of the browser

DRAWN = "[...document.querySelectorAll('.plot')].filter(box => box.querySelector('.main-svg'))"
HIDDEN = "[...document.querySelectorAll('details:not([open]) .plot')]"
MARK = "'.js-line[d], .point path, .bars path[d], .hm image'"
PAGES = ("diagnosis", "identification", "unsigned", "validation", "check", "audit", "drives")
PLOTS = {"validation": 6, "check": 9, "audit": 3, "drives": 7}  # at least, of a robot of three joints; two for each
EMPTY = f"{DRAWN}.filter(box => !box.querySelector({MARK})).map(box => box.ariaLabel)"
COLLIDE = """
[...document.querySelectorAll('.plot')].flatMap(plot => {
  const texts = [...plot.querySelectorAll('.xtick text, .ytick text, .g-xtitle text, .g-ytitle text, .cbaxis text')];
  const boxes = texts.map(text => [text.textContent, text.getBoundingClientRect()]).filter(([, box]) => box.width);
  const frame = plot.getBoundingClientRect();
  const within = b => b.left > frame.left - 1 && b.right < frame.right + 1 && b.bottom < frame.bottom + 1;
  const over = boxes.flatMap(([a, p], i) => boxes.slice(i + 1)
    .filter(([, q]) => p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 2 && q.top < p.bottom - 2)
    .map(([b]) => `${plot.ariaLabel}: ${a} on ${b}`));
  return [...over, ...boxes.filter(([, b]) => !within(b)).map(([text]) => `${plot.ariaLabel}: ${text} sticks out`)];
})
"""
NARROW, WIDE = (390, 700), 1300  # [pixels]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Reports of a diagnosis, two identifications (one without signs), a validation, a check and an audit."""
    folder = tmp_path_factory.mktemp("pages")
    names = notebook().names
    robot, given = names["robot"], names["recording"]
    texts = {
        "diagnosis": diagnosis_page(made()),
        "identification": identification_page(names["result"], command="signid identify 3r x"),
        "unsigned": identification_page(unsigned()),
        "validation": validation_page(signid.validate([signid.load_model("3r")] * 2, given)),
        "check": check_page(signid.check(robot, given)),
        "audit": audit_page(audit_servos(recording(drive(seconds=20)))),
        "drives": signid.report(invented()),
    }
    for name, text in texts.items():
        assert len(text) < 2e6, name
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    return {name: folder / f"{name}.html" for name in texts}


def show(browser: Chromium, page: Path, width: int = 1200, **media: str) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.send("Emulation.setDeviceMetricsOverride", **size)
    features = [{"name": "prefers-color-scheme", "value": media.pop("scheme", "light")}]
    browser.send("Emulation.setEmulatedMedia", media=media.get("medium", "screen"), features=features)
    browser.open(
        page.as_uri(),
        f"{DRAWN}.length > 0 && {DRAWN}.length + {HIDDEN}.length === document.querySelectorAll('.plot').length",
    )


def check_letters(browser: Chromium, width: int) -> None:
    assert browser.value("document.documentElement.scrollWidth") <= width
    assert browser.value(COLLIDE) == []


@pytest.mark.slow_cases(but="diagnosis|drives")
@pytest.mark.parametrize("name", PAGES)
def test_every_plot_is_drawn_and_nothing_is_loaded(browser: Chromium, pages: dict[str, Path], name: str) -> None:
    show(browser, pages[name], WIDE)
    assert browser.value(EMPTY) == []
    check_letters(browser, WIDE)
    hidden = browser.value(f"{HIDDEN}.length")
    for _ in range(browser.value("document.querySelectorAll('details:not([open]):has(.plot)').length")):
        browser.value("document.querySelector('details:not([open]):has(.plot)').scrollIntoView({block: 'center'})")
        browser.click("details:not([open]):has(.plot) > summary", 0.05)
        browser.until(f"{HIDDEN}.length < {hidden}")
        hidden = browser.value(f"{HIDDEN}.length")
    browser.until(f"{DRAWN}.length === document.querySelectorAll('.plot').length")
    assert browser.value(EMPTY) == [] and browser.value(f"{DRAWN}.length") >= PLOTS.get(name, 14)
    assert browser.errors == [] and all(url.startswith(("file:", "data:", "blob:")) for url in browser.requests)


def test_a_page_that_needs_the_network_is_caught(browser: Chromium, pages: dict[str, Path], tmp_path: Path) -> None:
    text = pages["diagnosis"].read_text(encoding="utf-8")
    broken = tmp_path / "broken.html"
    broken.write_text(text.replace("<main>", '<script src="https://example.com/a.js"></script><main>', 1), "utf-8")
    with pytest.raises(AssertionError):
        show(browser, broken)
        assert all(url.startswith(("file:", "data:", "blob:")) for url in browser.requests)


@pytest.mark.slow_cases(but="390-diagnosis")
@pytest.mark.parametrize("name", PAGES)
@pytest.mark.parametrize("width", NARROW)
def test_no_letters_run_into_each_other(browser: Chromium, pages: dict[str, Path], name: str, width: int) -> None:
    show(browser, pages[name], width)
    check_letters(browser, width)


@pytest.mark.parametrize("width", [390, 1280])
def test_all_columns_of_the_drives_are_on_the_screen(browser: Chromium, pages: dict[str, Path], width: int) -> None:
    show(browser, pages["drives"], width)
    cells = "[...document.querySelector('table').querySelectorAll('tbody tr:first-child td')]"
    shown = browser.value(f"{cells}.map(cell => [cell.dataset.head, cell.getBoundingClientRect().right])")
    assert len(shown) >= 9 and shown[0][0] == "joint" and all(0 < right <= width for _, right in shown)


@pytest.mark.slow_cases("dark")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_and_lines_stand_out_from_the_ground(browser: Chromium, pages: dict[str, Path], scheme: str) -> None:
    show(browser, pages["diagnosis"], scheme=scheme)
    ground = luminance(browser.value("getComputedStyle(document.body).backgroundColor"))
    assert (ground > 0.5) == (scheme == "light")
    for text in ("body", "figcaption", "th"):
        ink = luminance(browser.value(f"getComputedStyle(document.querySelector({text!r})).color"))
        assert contrast(ink, ground) > 4.5, text
    for mark, least in ((".xtick text", 4.5), (".js-line", 3.0)):
        style = "fill" if "text" in mark else "stroke"
        drawn = browser.value(f"[...document.querySelectorAll({mark!r})].map(x => getComputedStyle(x).{style})")
        assert drawn and all(contrast(luminance(colour), ground) > least for colour in set(drawn)), mark


def luminance(colour: str) -> float:
    """Relative luminance of "rgb(1, 2, 3)" (WCAG 2)."""
    parts = [float(x) / 255 for x in colour.partition("(")[2].rstrip(")").split(",")[:3]]
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: float, other: float) -> float:
    return (max(one, other) + 0.05) / (min(one, other) + 0.05)


@pytest.mark.slow
def test_paper_is_white_and_no_plot_is_wider_than_it(browser: Chromium, pages: dict[str, Path]) -> None:
    show(browser, pages["diagnosis"], 1200, scheme="dark", medium="print")
    browser.value("(dispatchEvent(new Event('beforeprint')), 0)")
    browser.until("[...document.querySelectorAll('.main-svg')].every(svg => svg.clientWidth <= 690)")
    assert luminance(browser.value("getComputedStyle(document.body).backgroundColor")) == pytest.approx(1)
    assert browser.value("document.querySelector('main').clientWidth") <= 700


@pytest.mark.slow
def test_dragging_zooms_and_a_double_click_goes_back(browser: Chromium, pages: dict[str, Path]) -> None:
    show(browser, pages["diagnosis"])
    browser.value("document.querySelector('details[open] .wide .plot').scrollIntoView({block: 'center'})")
    area = "document.querySelector('details[open] .wide .plot .nsewdrag').getBoundingClientRect()"
    left, top, width, height = browser.value(f"(r => [r.x, r.y, r.width, r.height])({area})")
    span = "(r => r[1] - r[0])(document.querySelector('details[open] .wide .plot').layout.xaxis.range)"
    whole = browser.value(span)
    steps = [("mousePressed", 0.3), ("mouseMoved", 0.4), ("mouseMoved", 0.6), ("mouseReleased", 0.6)]
    for kind, across in steps:
        place = {"x": left + across * width, "y": top + height * (0.3 + across / 2), "button": "left", "clickCount": 1}
        browser.send("Input.dispatchMouseEvent", type=kind, buttons=1, **place)
    browser.until(f"{span} < {0.5 * whole}")
    place = {"x": left + 0.5 * width, "y": top + 0.5 * height, "button": "left"}
    for count in (1, 2) * 10:  # on a busy machine two clicks may come too late to be one
        for kind in ("mousePressed", "mouseReleased"):
            browser.send("Input.dispatchMouseEvent", type=kind, clickCount=count, **place)
        if browser.value(f"{span} > {0.9 * whole}"):
            break
    browser.until(f"{span} > {0.9 * whole}")
