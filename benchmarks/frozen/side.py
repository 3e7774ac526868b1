"""One side of a comparison: runs cases with the signid that is imported, and writes their outputs as texts."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import signid
from signid.cli import run

SUITE = tomllib.loads(Path(__file__).with_name("cases.toml").read_text("utf-8"))
CASES: dict[str, str] = SUITE["cases"]
DONE, RECIPE = "made", "recipe.txt"  # marks complete inputs; holds what a case ran


class _Page(HTMLParser):
    """The words of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.lines, self.hidden = list[str](), 0

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.hidden += tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self.hidden -= tag in ("script", "style")

    def handle_data(self, data: str) -> None:
        if not self.hidden and data.strip():
            self.lines.append(" ".join(data.split()))


def text_of_file(path: Path) -> str:
    """A written file as text; of a page only the words."""
    page, text = _Page(), path.read_text("utf-8", "replace")
    page.feed(text if path.suffix == ".html" else "")
    return "\n".join(page.lines) or text


def texts_of_result(result: signid.Result) -> dict[str, str]:
    """The representation of a result and its tables."""
    names = repr(result).partition("to_frame(name): ")[2].partition("\nfigures")[0]
    tables = {name: result.to_frame(name).write_csv() for name in names.replace(",", " ").split()}
    return {"repr.txt": repr(result)} | {f"{name}.csv": text for name, text in tables.items()}


@contextlib.contextmanager
def _captured(prefix: Path) -> Iterator[None]:
    """Standard output and error go to files, also those of child processes."""
    kept = {fd: os.dup(fd) for fd in (1, 2)}
    try:
        for fd, name in ((1, ".stdout"), (2, ".stderr")):
            with prefix.with_name(prefix.name + name).open("wb") as file:
                os.dup2(file.fileno(), fd)
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for fd, copy in kept.items():
            os.dup2(copy, fd)
            os.close(copy)


def run_lines(commands: str, out: Path) -> None:
    """Run commands in this folder, and write their streams and exit codes to another."""
    codes = list[str]()
    for number, line in enumerate(commands.strip().splitlines(), 1):
        with _captured(out / str(number)):
            code = run(line.split())
        codes.append(f"{code}  {line}\n")
    (out / "codes.txt").write_text("".join(codes), encoding="utf-8")


def make_inputs(inputs: Path) -> None:
    """Make the inputs of all cases, unless they are there; those of the reference serve both sides."""
    if (inputs / DONE).exists():
        return
    given, said = SUITE["inputs"], inputs.with_name("inputs_said")
    for folder in (inputs, said):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    for file in given["copied"]:
        shutil.copy(file, inputs)
    for name, text in given["texts"].items():
        (inputs / name).write_text(text.lstrip(), encoding="utf-8")
    with contextlib.chdir(inputs):
        run_lines(given["commands"], said)
    if bad := [line for line in (said / "codes.txt").open(encoding="utf-8") if line[0] not in "03"]:
        sys.exit(f"an input cannot be made: {bad[0]}")
    (inputs / DONE).touch()


def run_case(name: str, inputs: Path, out: Path) -> None:
    """Run a case in a temporary folder, and write the texts of its streams and files."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    given = {path.name for path in inputs.iterdir()}
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        shutil.copytree(inputs, place, dirs_exist_ok=True)
        if CASES[name].startswith("signid."):
            try:
                texts = texts_of_result(eval(CASES[name], {"signid": signid}))
            except Exception as error:  # a difference, not an end of the suite
                texts = {"error.txt": repr(error)}
        else:
            run_lines(CASES[name], out)
            written = (path for path in sorted(Path().rglob("*")) if path.is_file() and path.parts[0] not in given)
            texts = {"__".join(path.parts): text_of_file(path) for path in written}
    for file, text in (texts | {RECIPE: CASES[name]}).items():
        (out / file).write_text(text, encoding="utf-8")


if __name__ == "__main__":  # OUT INPUTS CASE...
    out, inputs = (Path(word).resolve() for word in sys.argv[1:3])
    os.environ.update(COLUMNS="100", NO_COLOR="1")
    make_inputs(inputs)
    for name in sys.argv[3:]:
        run_case(name, inputs, out / name)
