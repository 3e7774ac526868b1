"""Every example in robots/ runs and identifies the true values."""

from __future__ import annotations

import importlib.util
import os
import runpy
from pathlib import Path
from types import ModuleType

import pytest

from signid.identify import Identification

EXAMPLES = sorted((Path(__file__).parents[1] / "robots").glob("*/identify.py"))
ASKING = [path for path in EXAMPLES if "recordings(" in path.read_text()]


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"example_{path.parent.name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_there_are_examples() -> None:
    assert {"1r", "3r"} <= {path.parent.name for path in EXAMPLES}


@pytest.mark.slow_cases("tx40|ur10e")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_example(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if path in ASKING and not os.environ.get("SIGNID_DATA"):
        pytest.skip("SIGNID_DATA is unset: real recordings are not part of the repository")
    result = load(path).main()
    assert isinstance(result, Identification)
    assert capsys.readouterr().out


@pytest.mark.parametrize("path", ASKING, ids=lambda path: path.parent.name)
def test_an_example_without_recordings_names_the_download_command(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIGNID_DATA", str(path))
    with pytest.raises(SystemExit, match=f"signid data {path.parent.name}"):
        runpy.run_path(str(path), run_name="__main__")
