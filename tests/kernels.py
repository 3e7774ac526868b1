"""Kernels of OpenBLAS, that is of the matrix products of different processors, in subprocesses."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

KERNELS = {  # kernel -> instructions that it needs, as older and newer versions of numpy call them
    "Nehalem": {"SSE42", "X86_V2"},
    "Haswell": {"AVX2", "X86_V3"},
    "SkylakeX": {"AVX512_SKX", "X86_V4"},
}


def available() -> list[str]:
    """Kernels that numpy's OpenBLAS can be asked for on this machine."""
    config = np.show_config("dicts")
    if platform.machine() not in ("x86_64", "AMD64") or "openblas" not in config["Build Dependencies"]["blas"]["name"]:
        return []
    simd = {*config["SIMD Extensions"]["baseline"], *config["SIMD Extensions"]["found"]}
    return [name for name, needed in KERNELS.items() if needed & simd]


several = pytest.mark.skipif(
    len(available()) < 2, reason="numpy does not use OpenBLAS, or the processor has one kernel only"
)


def run_python(kernel: str, arguments: Sequence[str], folder: Path) -> int:
    """Exit code of Python with these arguments, in a folder, under a kernel."""
    here = {**os.environ, "OPENBLAS_CORETYPE": kernel, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run([sys.executable, *arguments], env=here, cwd=folder, capture_output=True, text=True)
    assert done.returncode in (0, 3), done.stderr
    return done.returncode
