"""Recovered signs as a page for the browser."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import plotly.graph_objects as go
from test_signs_report import FLAGS, JOINTS, found, trace

from signid.output.report.results.signs import MOST, proof_sentence, signs_page


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


def test_the_page_is_the_same_every_time() -> None:
    assert signs_page(found(2)) == signs_page(found(2))


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


def test_lines_are_broken_where_a_span_begins_and_keep_their_peaks() -> None:
    for samples in (600, 20_000):
        signs = found(samples=samples)
        size = signs.traces[0].magnitude.copy()
        size[samples // 2, 0] = 17.0
        signs = replace(signs, traces=(replace(signs.traces[0], magnitude=size),))
        drawn, _ = figures(signs_page(signs))
        lines = {line.name: values(line.to_plotly_json()["y"]) for line in drawn.data if line.type == "scatter"}
        assert set(lines) == {"absolute torque", "threshold", "signed torque", "model"}
        assert list(lines.pop("threshold")) == [0.4, 0.4]
        for y in lines.values():
            assert np.isnan(y).sum() == 1 and min(samples, MOST // 2) < len(y) <= MOST + 1
        assert np.nanmax(lines["absolute torque"]) == 17.0
        signed = size[:, 0] * signs.traces[0].signs[:, 0]
        ends = np.nanmin(lines["signed torque"]), np.nanmax(lines["signed torque"])
        np.testing.assert_allclose(ends, (signed.min(), signed.max()), rtol=1e-6)


def test_many_short_spans_stay_within_the_points() -> None:
    t = np.arange(20_000) * 0.02
    one = replace(trace("", t, [0]), first=np.arange(0, 20_000, 10))
    drawn, _ = figures(signs_page(replace(found(), traces=(one,), segments=())))
    assert max(len(values(line.to_plotly_json()["y"])) for line in drawn.data if line.type == "scatter") <= MOST
