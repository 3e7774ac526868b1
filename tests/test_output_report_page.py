"""A diagnosis as a page for the browser: its text, and plots that agree with the numbers."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from test_output_report_diagnosis import AFTER, APART, BEFORE, FINDINGS, FLAG, FLOOR, NEVER, ROBOT, course, made, rolled
from test_signs_page import Page, figures, values

from signid.diagnose import Diagnosis
from signid.diagnose.thresholds import AMBIGUOUS_WORDS
from signid.output.report.results.diagnosis import diagnosis_page, diagnosis_tables


def test_the_page_says_the_same_and_loads_nothing() -> None:
    page = diagnosis_page(made(), command="signid diagnose 3r x.csv -o DIR")
    read = Page(page)
    text = " ".join(" ".join(read.texts).split())
    says = (
        "3r: the simulation lacks",
        FLAG,
        "a <note>",
        NEVER,
        APART,
        "0.800",
        "0.020",
        "Coulomb friction of joint_2: 0.80 ± 0.02 N.m",
    )
    source = FINDINGS[0].law.effect.source
    inputs = ("x.csv", "0" * 64, "recording, learned from", "signid diagnose 3r x.csv -o DIR", "seed 7", "robot.urdf")
    for words in (*says, *inputs, source, FINDINGS[0].law.effect.equation, "first_moment_x", "kg.m", "joint_3: 5 % of"):
        assert words in text, words
    assert "of" not in read.tags and "note" not in read.tags and len(page) < 2e6
    assert page == diagnosis_page(made(), command="signid diagnose 3r x.csv -o DIR")
    for result in (made(verdict="unknown"), made(verdict="nothing_missing", findings=(), unexplained=(), flags=())):
        assert f'<header class="top {result.verdict}' in diagnosis_page(result)


def test_a_headline_is_red_if_flags_say_that_the_result_is_unreliable() -> None:
    ambiguous = f"payload of joint_3 {AMBIGUOUS_WORDS} (80%); the others: link_inertia of joint_3 (20%)"
    for flags, red in (((), False), ((ambiguous,), False), ((ambiguous, "the torque is shifted by 1 s"), True)):
        result = made(flags=flags)
        page = diagnosis_page(result)
        assert ('<header class="top named unreliable">' in page, "say what not to rely on" in page) == (red, red)
        style = getattr(diagnosis_tables(result)[0], "style", "")
        assert (style == "bold red") == red


def lines(result: Diagnosis, title: str) -> dict[str, Any]:
    """The traces of the plots with a title on their horizontal axis, by name; those of the last joint win."""
    drawn = [plot for plot in figures(diagnosis_page(result)) if plot.layout.xaxis.title.text == title]
    assert drawn and all(plot.layout.yaxis.title.text or plot.data[0].type == "heatmap" for plot in drawn), title
    return {trace.name: trace.to_plotly_json() for plot in drawn for trace in plot.data if trace.name}


def test_every_plot_states_quantity_and_unit() -> None:
    plots = figures(diagnosis_page(made()))
    assert len(plots) == 2 * 4 + 3 * 4 + 3
    for plot in plots:
        axes = [plot.layout[key] for key in plot.layout if key.startswith(("xaxis", "yaxis"))]
        titles = [axis.title.text for axis in axes if axis.type != "category"]
        assert titles and all(re.search(r" \[.+\]$", title) for title in titles), titles
        assert any(
            np.isfinite(values(trace.to_plotly_json()["y"])).any() for trace in plot.data if trace.type != "heatmap"
        ) or (plot.data[0].type == "heatmap")


def test_torque_over_time_and_its_residual_are_those_of_the_course() -> None:
    traces, judged = lines(made(), "time [s]"), course(120, 2)
    assert set(traces) == {"measured", "predicted before", "predicted after", "residual before", "residual after"}
    measured, after = (values(traces[name]["y"]) for name in ("measured", "residual after"))
    kept = np.isfinite(measured)
    np.testing.assert_allclose(np.nanmax(np.abs(after)), AFTER[2], rtol=1e-6)
    np.testing.assert_allclose(measured[kept].max(), judged.torque[:, 2].max(), rtol=1e-6)
    assert np.all(np.diff(values(traces["measured"]["x"])) >= 0), "one recording after the other"


def test_the_heat_map_is_the_residual_over_the_noise_floor() -> None:
    plots = [plot for plot in figures(diagnosis_page(made())) if plot.data[0].type == "heatmap"]
    assert len(plots) == 8
    for plot, size in zip(plots, [BEFORE] * 4 + [AFTER] * 4, strict=True):
        (trace,) = plot.data
        assert list(trace.y) == list(ROBOT.joints)
        z = values(trace.to_plotly_json()["z"]).reshape(3, -1)
        expected = np.log10(np.maximum(size / FLOOR, 1))
        np.testing.assert_allclose(np.nanmax(z, axis=1), expected, atol=1e-6)
        np.testing.assert_allclose(np.nanmin(z, axis=1), expected, atol=1e-6)
        assert 10**trace.zmax == pytest.approx(20.0)
    page = diagnosis_page(made(findings=()))
    assert sum(plot.data[0].type == "heatmap" for plot in figures(page)) == 4, "nothing was added: no map after"


@pytest.mark.parametrize("flown", [False, True])
def test_roll_outs_are_drawn_as_time_passes(flown: bool) -> None:
    traces = lines(made(rollout_before=rolled(np.inf)) if flown else made(), "time since the start [s]")
    before, after = (values(traces[name]["y"]) for name in ("before", "after"))
    np.testing.assert_allclose(after, 0.03, rtol=1e-6)
    assert np.isnan(before).all() if flown else np.allclose(before, 1.5)


def test_without_a_roll_out_none_is_drawn() -> None:
    page = diagnosis_page(made(rollout_before=None, rollout_after=None))
    assert "Simulated from measured states" not in page and len(figures(page)) == 8 + 12
