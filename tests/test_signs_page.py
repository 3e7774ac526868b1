"""Recovered signs as a page for the browser."""

from __future__ import annotations

import base64
import json
from html.parser import HTMLParser
from typing import Any

import numpy as np
import plotly.graph_objects as go
from test_signs_report import FLAGS, JOINTS, found

from signid.output.report.results.signs import proof_sentence, signs_page


class Page(HTMLParser):
    """Visible text of a page and its scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.scripts: list[str] = []
        self.tags: list[str] = []
        self._within = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self._within = tag
        assert not any(name in ("src", "href") and text != "data:," for name, text in attrs), "the page loads something"

    def handle_data(self, data: str) -> None:
        (self.scripts if self._within == "script" else self.texts).append(data)

    def handle_endtag(self, tag: str) -> None:
        self._within = ""


def figures(page: str) -> list[go.Figure]:
    """The figures of a page, checked against plotly's schema."""
    plots = [json.loads(script) for script in Page(page).scripts if script.startswith('{"data":')]
    return [go.Figure(**plot) for plot in plots]


def values(array: Any) -> np.ndarray:
    """Values of a line in plotly's encoding: a list, or base64."""
    if not isinstance(array, dict):
        return np.array(array, float)
    return np.frombuffer(base64.b64decode(array["bdata"]), array["dtype"])


def test_the_page_shows_every_joint_and_flag() -> None:
    signs = found()
    page = signs_page(signs)
    read = Page(page)
    text = " ".join(read.texts)
    for sentence in (*FLAGS, "a note", proof_sentence(signs), "session_0.csv", "shoulder", JOINTS[2]):
        assert sentence in text, sentence
    for mark in ("sign +", "sign −", "confidence below 0.999", "absolute torque", "signed torque", "model"):
        assert mark in text, mark
    assert JOINTS[1] not in text and "b" not in read.tags and read.tags.count("script") == 2 + len(figures(page))
    assert "N.m or N" in page and "[N.m]" in signs_page(signs, ["N.m", "N.m", "N"])
    titles = [drawn.layout.yaxis.title.text for drawn in figures(signs_page(signs, ["N.m", "N.m", "N"]))]
    assert titles == ["torque [N.m]", "torque [N]"]


def test_every_segment_is_shaded_by_its_sign() -> None:
    signs = found(2)
    drawn = figures(signs_page(signs))
    assert len(drawn) == 4
    for plot, (part, joint) in zip(drawn, ((0, 0), (0, 2), (1, 0), (1, 2)), strict=True):
        own = [x for x in signs.of(joint) if x.part == part]
        bars = {bar.name: bar for bar in plot.data if bar.type == "bar"}
        sure = [x for x in own if x.confidence >= 0.999]
        counts = [sum(x.sign > 0 for x in sure), sum(x.sign < 0 for x in sure), len(own) - len(sure)]
        assert [len(bar.text) for bar in bars.values()] == counts and min(counts) >= 0 and sum(counts) == len(own)
        edges = sorted((x - w / 2, x + w / 2) for b in bars.values() for x, w in zip(b.x, b.width, strict=True))
        np.testing.assert_allclose(edges, sorted((x.start - 0.01, x.end + 0.01) for x in own), atol=1e-9)
        for bar in bars.values():
            assert all(text[0] == row[0] in "+−" for text, row in zip(bar.text, bar.customdata, strict=True))
