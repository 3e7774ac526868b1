"""Destinations of results: early checks, column files, the list of written files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import OptionError

if TYPE_CHECKING:
    from ..types import Array


def check_folder(output: str | None, json: bool) -> None:
    """Check that results can be written to a folder.

    Args:
        output: folder, if named.
        json: results are printed, so that no folder is needed.

    Raises:
        OptionError: no folder was named.
        OutputError: the folder is not writable.
    """
    from ..output.report import probe_folder

    if output == "" or (output is None and not json):
        raise OptionError("no folder for the results was named; add -o DIR, or --json to print them instead")
    if output is not None:
        probe_folder(output)


def check_file(output: str | None, json: bool) -> None:
    """Check that a recording can be written to a file.

    Args:
        output: file, if named.
        json: a summary is printed, so that no file is needed.

    Raises:
        OptionError: no file was named, or its format is read-only.
        RecordingError: the format is unknown.
        OutputError: the folder is not writable.
    """
    from ..output.report import probe_folder
    from ..recording.formats import find_format

    if output == "" or (output is None and not json):
        raise OptionError("no file for the result was named; add -o FILE, or --json to print a summary instead")
    if output is not None:
        form = find_format(Path(output))
        if not form.writes:
            form.encode({}, output)
        probe_folder(Path(output).parent)


def write_columns(output: str | None, columns: Mapping[str, Array]) -> Sequence[Path]:
    """Write columns to a file, if one was named.

    Args:
        output: file name; it appears when complete.
        columns: (N,) each, by name [units of the columns of these names].
    """
    from ..output.report import write_files
    from ..recording.formats import find_format

    if output is None:
        return []
    path = Path(output)
    return write_files(path.parent, {path.name: find_format(path).encode(columns, path.name)})


def list_written(written: Sequence[Path]) -> None:
    """Print the paths of written files below a result."""
    from ..output.report import Screen

    if written:
        Screen().write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
