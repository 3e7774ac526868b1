"""Public benchmarks: cited rows, digests, and the score of the published EMPS parameters."""

from __future__ import annotations

import os

import pytest

from benchmarks.public import JANOT, OTHERS, Entry, files, published, scored


def test_every_row_of_others_has_a_source() -> None:
    assert all(row.source and row.test for row in OTHERS)


def test_the_digest_follows_the_numbers() -> None:
    first, second = (Entry("a", published(mass), JANOT, 0.0) for mass in (95.0, 95.1))
    assert first.digest == Entry("b", published(95.0), JANOT, 1.0).digest != second.digest


def test_published_parameters_score_as_cited() -> None:
    if not os.environ.get("SIGNID_DATA"):
        pytest.skip("SIGNID_DATA is not set; real recordings are not in the repository")
    row = scored(Entry("published", published(), JANOT, 0.0), *files())
    assert row.numbers == 4
    assert row.train == pytest.approx(5.66, abs=0.1) and row.test == pytest.approx(8.87, abs=0.1)
