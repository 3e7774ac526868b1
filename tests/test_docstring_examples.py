"""Examples in the docstrings of public names run, and give what they state."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path

import pytest

import signid

ROOT = Path(__file__).parents[1]
EXAMPLES = 20  # names with an example
FOUND = {
    name: doctest.DocTestParser().get_examples(inspect.getdoc(getattr(signid, name)) or "") for name in signid.NAMES
}
SHOWN = [name for name, examples in FOUND.items() if examples]


def test_the_names_most_used_have_an_example() -> None:
    assert len(SHOWN) >= EXAMPLES and {"identify", "diagnose", "simulate", "validate"} <= {*SHOWN}


@pytest.mark.parametrize("name", SHOWN)
def test_an_example_runs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)  # where the recordings of the examples are
    test = doctest.DocTest(FOUND[name], {"signid": signid}, name, None, None, None)
    assert doctest.DocTestRunner().run(test).failed == 0
