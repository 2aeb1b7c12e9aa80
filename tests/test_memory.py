"""Memory that runs out is an error; ``memory_limits.py`` tries more limits and more calls."""

from __future__ import annotations

import ast
import os
import signal
import sys

import pytest

import memory_limits
import processes
from impasto import _core

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

SMALLER = """
import numpy as np
import impasto
import memory_limits
from impasto.lighting import reduced
memory_limits.keep_no_room()
normal = np.zeros((3, 1024, 1024), np.float32)
normal[2] = 1.0
diffuse = np.full((33, 1024, 1024), 0.5, np.float32)
surface = impasto.Surface(normal=normal, diffuse=diffuse, lobes=(), model="lafortune")
call = lambda: reduced(surface, None, 1, 1)
maps = normal.nbytes + diffuse.nbytes
rooms = [maps * step // 4 for step in (2, 4, 6, 8, 9, 10, 11)]
print([memory_limits.limited(call, room)[0] for room in rooms])
"""


def test_a_call_without_memory_raises() -> None:
    """Results where there is enough, MemoryError elsewhere; the process goes on in any case."""
    found = ast.literal_eval(processes.run(SWEEP))
    assert len(found) == 3
    for call, endings in found.items():
        assert endings.keys() <= {memory_limits.RESULT, memory_limits.REFUSED}, call
        assert endings.keys() >= {memory_limits.RESULT, memory_limits.REFUSED}, call


def test_smaller_maps_take_no_more_memory_than_they_ask_for() -> None:
    """They are made where they will stand: two and a half times their size are enough."""
    endings = ast.literal_eval(processes.run(SMALLER))
    assert set(endings) <= {memory_limits.RESULT, memory_limits.REFUSED}, endings
    assert endings[0] == memory_limits.REFUSED
    assert endings[-2:] == [memory_limits.RESULT] * 2


BRIEF = """
import numpy as np
import impasto
import memory_limits
memory_limits.keep_no_room()
lights = [(0.5, 0, 0.9), (0, 0.5, 0.9), (-0.5, 0, 0.9), (0, -0.5, 0.9)]
small, large = (
    impasto.Stack(np.full((4, 1, side, side), 0.5, np.float32), lights=lights)
    for side in (128, 129)
)
part = small[:16, :16]
normals = impasto.fit_normals(part, method="least-squares", threads=1)
slow = impasto.Effort(rounds=2000)
calls = [
    lambda: impasto.fit_normals(small, method="least-squares", threads=1),
    lambda: impasto.fit_normals(large, method="least-squares", threads=1),
    lambda: lobes(normals=normals),
    lambda: lobes(normals=normals, effort=slow),
    lambda: shadows((64, 64), (0.6, 0.0, 0.8)),
    lambda: shadows((1, 4096), (99.0, 0.0, 9.0), point=True),
]
def shadows(shape, light, **options):
    impasto.cast_shadows(np.zeros(shape, np.float32), 0.1, light, threads=1, **options)
def lobes(**options):
    impasto.fit_sbrdf(part, pooling="pixel", check=False, refine=False, threads=1, **options)
print([memory_limits.limited(call, {room} << 20)[0] for call in calls])
"""


def test_a_fit_of_few_samples_starts_no_thread() -> None:
    """65,536 samples and fewer, in a usual search or along short rays; a thread takes 66 MiB."""
    below, above = (ast.literal_eval(processes.run(BRIEF.format(room=room))) for room in (80, 160))
    if _core.build_info()["simd"] == "baseline":  # nothing is quick enough
        assert below == 6 * [memory_limits.REFUSED]
    else:
        assert below == 3 * [memory_limits.RESULT, memory_limits.REFUSED]
    assert above == 6 * [memory_limits.RESULT]


def test_an_ended_process_is_a_fault() -> None:
    ending, _ = memory_limits.limited(lambda: os.kill(os.getpid(), signal.SIGKILL), None)
    assert ending == -signal.SIGKILL
