"""The frozen suite finds every difference that it should, and one cheap case gives what is stored."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.frozen import side
from benchmarks.frozen.compare import compare, compare_stored, differing_lines, principal

STORED = Path(side.__file__).with_name("stored.json")
TEXT = 'mass of link_3: 0.30 kg\n  "value": 0.2742160151891532,\n  "zero": 1e-17, version 0.2.0\n'
DOCUMENT = {"codes.txt": ["0  inspect 3r"], "1.stdout": {"value": [2.0, 1e-9], "flag": "weak"}}


@pytest.mark.parametrize(
    "old, new",
    [("0.2742160151891532", "0.2742160151891911"), ("1e-17", "-3.4694469519536e-18"), ("0.2.0", "0.3.0")],
)
def test_rounding_and_versions_are_no_difference(old: str, new: str) -> None:
    assert not list(differing_lines(TEXT, TEXT.replace(old, new)))


@pytest.mark.parametrize(
    "old, new",
    [
        ("0.2742160151891532", "0.2742160161891532"),
        ("0.2742160151891532", "0.27"),
        ("0.30", "0.3"),
        ("link_3", "link_2"),
        ("mass", "Mass"),
        (" kg", ""),
        ("1e-17", "null"),
    ],
)
def test_a_line_that_differs_is_found_with_both_its_states(old: str, new: str) -> None:
    [(before, after)] = differing_lines(TEXT, TEXT.replace(old, new))
    assert before is not None and after is not None and after == before.replace(old, new)


def test_lines_that_are_new_or_gone_are_found_alone() -> None:
    longer = TEXT.replace("\n", "\nanother 1.5\n", 1)
    assert list(differing_lines(TEXT, longer)) == [(None, "another 1.5")]
    assert list(differing_lines(longer, TEXT)) == [("another 1.5", None)]


def test_a_missing_file_is_found(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        (tmp_path / folder / "case").mkdir(parents=True)
        (tmp_path / folder / "case/a.txt").write_text(TEXT)
    (tmp_path / "one/case/b.txt").write_text(TEXT)
    [found] = compare(tmp_path / "one", tmp_path / "other", ["case"])
    assert (found.case, found.file, found.before, found.after) == ("case", "b.txt", TEXT, None)


def test_stored_numbers_agree_to_the_digits_of_the_largest_of_their_kind() -> None:
    def found(value: list[float], flag: str = "weak") -> list[str]:
        now = DOCUMENT | {"1.stdout": {"value": value, "flag": flag}}
        return [each.file for each in compare_stored({"case": DOCUMENT}, {"case": now})]

    assert found([2.000001, 1e-6]) == []
    assert found([2.00001, 1e-9]) == ["/1.stdout/value/0"] and found([2.0, 1e-5]) == ["/1.stdout/value/1"]
    assert found([2.0]) == ["/1.stdout/value/1"] and found([2.0, 1e-9], "good") == ["/1.stdout/flag"]


def test_a_case_gives_what_is_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    (tmp_path / "inputs").mkdir()
    with capfd.disabled():  # the suite captures the streams itself
        side.run_case("inspect", tmp_path / "inputs", tmp_path / "inspect")
    stored = json.loads(STORED.read_text())
    assert stored.keys() == side.CASES.keys()
    assert compare_stored(stored, {"inspect": principal("inspect", tmp_path / "inspect")}) == []
