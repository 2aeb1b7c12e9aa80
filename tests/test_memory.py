"""Memory that runs out is an error; ``memory_limits.py`` tries more limits and more calls."""

from __future__ import annotations

import ast
import os
import signal
import sys

import pytest

import memory_limits
import processes

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="limits memory as Linux does"),
]

SWEEP = """
import tempfile
from pathlib import Path
import memory_limits
with tempfile.TemporaryDirectory() as name:
    known = memory_limits.calls(96, Path(name))
    chosen = ("integrate_normals", "fit_sbrdf", "render")
    print({call: dict(memory_limits.sweep(known[call], 4)) for call in chosen})
"""


def test_a_call_without_memory_raises() -> None:
    """Results where there is enough, MemoryError elsewhere; the process goes on in any case."""
    found = ast.literal_eval(processes.run(SWEEP))
    assert len(found) == 3
    for call, endings in found.items():
        assert endings.keys() <= {memory_limits.RESULT, memory_limits.REFUSED}, call
        assert endings.keys() >= {memory_limits.RESULT, memory_limits.REFUSED}, call


def test_an_ended_process_is_a_fault() -> None:
    ending, _ = memory_limits.limited(lambda: os.kill(os.getpid(), signal.SIGKILL), None)
    assert ending == -signal.SIGKILL
