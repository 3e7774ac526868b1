"""Models as files: the bytes of model.json."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import OutputError
from ..report.documents import to_json
from ..report.write import write_files

if TYPE_CHECKING:
    from ...model import Model


def save_model(model: Model, path: str | Path) -> Path:
    """Write a model.json; it appears when it is complete.

    Raises:
        OutputError: the name does not end in .json, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != ".json":
        better = target.with_suffix(".json").name
        raise OutputError(f"a model is saved as JSON, and {target.name} does not end in .json; name it {better}")
    text = to_json(model.document())
    return write_files(target.parent, {target.name: text}, "another path", named=True)[0]
