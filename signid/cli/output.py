"""Where results go: whether a folder or a file can be written, before anything is done, and the file of columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import OptionError

if TYPE_CHECKING:
    from ..types import Array


def check_folder(output: str | None, json: bool) -> None:
    """Find out at once whether results can be written.

    Raises:
        OptionError: no folder was named.
        OutputError: it cannot be written to.
    """
    from ..output.report import probe_folder

    if output == "" or (output is None and not json):
        raise OptionError("no folder for the results was named; add -o DIR, or --json to print them instead")
    if output is not None:
        probe_folder(output)


def check_file(output: str | None, json: bool) -> None:
    """Find out at once whether the recording can be written.

    Raises:
        OptionError: no file was named, or files of its kind are only read.
        RecordingError: its name is of no known format.
        OutputError: its folder cannot be written to.
    """
    from ..output.report import probe_folder
    from ..recording.formats.find import find_format

    if output == "" or (output is None and not json):
        raise OptionError("no file for the result was named; add -o FILE, or --json to print what is told of it")
    if output is not None:
        form = find_format(Path(output))
        if not form.writes:
            form.encode({}, output)
        probe_folder(Path(output).parent)


def write_columns(output: str | None, columns: Mapping[str, Array]) -> Sequence[Path]:
    """The file, if one was named; it appears when it is complete.

    Args:
        output: its name.
        columns: (N,) each, by name [units of the columns of these names].
    """
    from ..output.report import write_files
    from ..recording.formats.find import find_format

    if output is None:
        return []
    path = Path(output)
    return write_files(path.parent, {path.name: find_format(path).encode(columns, path.name)})
