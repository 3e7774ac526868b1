"""A process that gives mutated files to readers: `python -m benchmarks.fuzz.worker STATE NOISE MODULE`.

Orders come by standard input. The file STATE holds the number and the start of the current input, so that the
supervisor sees which input hangs or ends the process. All that libraries print goes to the file NOISE. The input is
the same for the same seed, reader and number.
"""

from __future__ import annotations

import json
import mmap
import os
import re
import struct
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9.]*")
NUMBERS = (  # in place of numbers
    b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e308", b"-1e308", b"1e300", b"1e150", b"1e30", b"1e12", b"1e10",
    b"1e9", b"-1e9", b"1e5", b"1e-5", b"1e-9", b"1e-150", b"1e-310", b"5e-324", b"1e400", b"-0.0", b"0", b"-1", b"1",
    b"2147483648", b"18446744073709551616", b"1" + b"0" * 400, b"0x1F", b"1_0", b"true", b"null", b"[]", b"{}",
    b'"1"', b'""', b"", b"1,5", b"1e", b"0.1.2", b"--1", b"[1]", b"[[1, 2], 3]", b'{"a": 1}', b"1 2", b"1;2",
)  # fmt: skip
MOST = 400_000  # [bytes] length of an input


def mutated(seeds: Sequence[bytes], tokens: Sequence[bytes], rng: Random) -> bytes:
    """One of the seed files with one to six mutations, seldom another content altogether."""
    if rng.random() < 0.005:
        return rng.choice((b"", rng.randbytes(rng.randrange(1, 200)), rng.choice(tokens)))
    content = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 6))):
        binary = b"\0" in content
        content = (rng.choice(BYTES) if binary or rng.random() < 0.3 else rng.choice(WORDS))(content, tokens, rng)
    return content[:MOST]


def _flip(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    changed = bytes(x ^ (1 << rng.randrange(8)) for x in content[at : at + 1])
    return content[:at] + changed + content[at + 1 :]


def _overwrite(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at, length = rng.randrange(len(content) + 1), rng.choice((1, 2, 4, 8))
    new = rng.choice((rng.randbytes(length), b"\xff" * length, b"\0" * length, b"\x7f" + b"\xff" * (length - 1)))
    return content[:at] + new + content[at + length :]


def _insert(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice(tokens) + content[at:]


def _remove(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + content[at + rng.choice((1, 4, 20, 100)) :]


def _cut(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _repeat(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    at, length = rng.randrange(len(content) + 1), rng.choice((1, 10, 100))
    return content[:at] + content[at : at + length] * rng.choice((2, 3, 50)) + content[at + length :]


def _number(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    found = list(NUMBER.finditer(content))
    return _replaced(content, rng.choice(found), rng.choice(NUMBERS)) if found else content


def _word(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    """Replace a word by another one of the file, or by a token."""
    found = list(WORD.finditer(content))
    if not found:
        return content
    other = rng.choice(found).group() if rng.random() < 0.8 else rng.choice(tokens)
    return _replaced(content, rng.choice(found), other)


def _lines(content: bytes, tokens: Sequence[bytes], rng: Random) -> bytes:
    """Repeat, remove or exchange pieces between line ends, or between tags and brackets."""
    parts = re.split(rb"(?<=[\n>,;}\]])", content)
    at, other = rng.randrange(len(parts)), rng.randrange(len(parts))
    if (what := rng.randrange(3)) == 0:
        parts[at:at] = [parts[other]] * rng.choice((1, 2, 30))
    elif what == 1:
        del parts[at]
    else:
        parts[at], parts[other] = parts[other], parts[at]
    return b"".join(parts)


def _replaced(content: bytes, place: re.Match[bytes], new: bytes) -> bytes:
    return content[: place.start()] + new + content[place.end() :]


BYTES = (_flip, _overwrite, _insert, _remove, _cut, _repeat)
WORDS = (_number, _number, _number, _word, _lines)


STATE = struct.Struct("qdqqd")
SECONDS, MEMORY, GROWTH = 10.0, 3_000_000_000, 1_000_000  # [s] of processor; [bytes] address space; [kB] of one input
HERE = Path(__file__).parents[2]


class Progress(NamedTuple):
    """Contents of STATE."""

    number: int = -1  # of the current input
    start: float = 0.0  # [s] of it, monotonic
    refused: int = 0
    accepted: int = 0
    seconds: float = 0.0  # of the processor, for all inputs of the order


def content_of(reader: Any, tokens: Any, seed: int, number: int) -> bytes:
    """The input of this number."""
    return mutated(reader.seeds, tokens, Random(f"{seed} {reader.name} {number}"))


def give(reader: Any, content: bytes, place: Path) -> tuple[bool, str]:
    """Whether an input was accepted, and the fault: "" if it ended in a result or in a refusal."""
    before, start = peak_memory(), time.process_time()
    try:
        accepted, fault = reader(content, place), ""
    except Exception as error:
        accepted, fault = False, f"{type(error).__name__}: {_first(str(error))} ({_where(error)})"
    if time.process_time() - start > SECONDS:
        fault = fault or f"over {SECONDS:.0f} s"
    if peak_memory() - before > GROWTH:
        fault = fault or f"over {GROWTH / 1000:.0f} MB"
    return accepted, fault


def _first(text: str) -> str:
    return re.sub(r"\S{80,}", "...", text)[:100].replace("\n", " ")


def _where(error: Exception) -> str:
    """Place of the last line of signid in a traceback."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename.startswith(str(HERE))]
    return f"{Path(frames[-1].filename).relative_to(HERE)}:{frames[-1].lineno}" if frames else "unknown"


def limit_memory() -> None:
    """Limit the address space to that of now and MEMORY, where the system states it."""
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if (pages := Path("/proc/self/statm")).exists():
        size = int(pages.read_text(encoding="utf-8").split()[0]) * mmap.PAGESIZE + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (size, resource.getrlimit(resource.RLIMIT_AS)[1]))


def peak_memory() -> int:
    """Largest memory of this process [kB]."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main(state_file: str, noise_file: str, module: str) -> None:
    """Carry out orders until standard input ends; print findings and the end of each order as JSON lines."""
    answers = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    noise = os.open(noise_file, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    os.dup2(noise, 1)
    os.dup2(noise, 2)
    source = import_module(module)
    known = {reader.name: reader for reader in source.readers()}
    warnings.simplefilter("ignore")
    with (
        open(state_file, "r+b") as file,
        tempfile.TemporaryDirectory(dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None) as folder,
    ):
        state, place = mmap.mmap(file.fileno(), STATE.size), Path(folder)
        for line in sys.stdin:
            order = json.loads(line)
            reader = known[order["reader"]]
            reader(reader.seeds[0], place)  # imports
            limit_memory()
            now, begun, heard = Progress(), time.process_time(), os.fstat(noise).st_size
            for number in range(order["start"], order["stop"]):
                content = content_of(reader, source.TOKENS, order["seed"], number)
                now = now._replace(number=number, start=time.monotonic(), seconds=time.process_time() - begun)
                STATE.pack_into(state, 0, *now)
                accepted, fault = give(reader, content, place)
                if (size := os.fstat(noise).st_size) > heard:
                    printed = os.pread(noise, 300, heard).decode("utf-8", "replace")
                    fault, heard = fault or f"printed: {_first(printed)}", size
                now = now._replace(accepted=now.accepted + accepted, refused=now.refused + (not accepted))
                if fault:
                    answers.write(json.dumps({"number": number, "fault": fault}) + "\n")
            now = now._replace(number=-1, seconds=time.process_time() - begun)
            STATE.pack_into(state, 0, *now)
            answers.write(json.dumps({"done": True, "peak": peak_memory() // 1000}) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
