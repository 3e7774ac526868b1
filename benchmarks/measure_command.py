"""Processor time and memory of one signid command: `python -m benchmarks.measure_command FILE [--profile] COMMAND ...`.

The command runs like `signid COMMAND ...`, in a process without earlier imports. FILE receives the exit code, the
processor time [s], the time before signid was imported [s] and the peak memory [MB]; FILE.prof the output of cProfile.
"""

from __future__ import annotations

import cProfile
import json
import sys
import time
from pathlib import Path


def peak() -> float:
    """Peak memory of this process [MB], without that of its parent where the system reports it."""
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(x for x in status.read_text(encoding="utf-8").splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) * 1.024e-3
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1e-6 if sys.platform == "darwin" else 1.024e-3)


def main() -> None:
    """Run the command and write its numbers."""
    target, *command = sys.argv[1:]
    profile, started = cProfile.Profile(time.process_time), time.process_time()
    if profiled := command[0] == "--profile":
        profile.enable()
    from signid.cli import run  # imported here so that its time is counted

    code = run(command[profiled:])
    profile.disable()
    numbers = {"code": code, "seconds": time.process_time(), "started": started, "memory": peak()}
    Path(target).write_text(json.dumps(numbers), encoding="utf-8")
    if profiled:
        profile.dump_stats(f"{target}.prof")


if __name__ == "__main__":
    main()
