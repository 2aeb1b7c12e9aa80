"""A job keeps to its memory: what grows with the picture stays on the disk."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import processes

pytest.importorskip("fcntl", reason="jobs need POSIX")
pytestmark = pytest.mark.slow

BUDGET = 64 << 20
SIDES = (256, 2048)
LAMPS = ((0.5, 0.0), (0.0, 0.5), (-0.5, 0.0), (0.0, -0.5), (0.2, 0.3), (-0.3, 0.2))

PROGRAM = """
import json, sys
import numpy as np
import impasto
from impasto._internal.peak import peak_bytes
lights = json.loads(sys.argv[1])
peaks = []
for path in sys.argv[3:]:
    stack = impasto.Stack(np.load(path, mmap_mode="r"), lights=lights, scale=1 / 255)
    impasto.run(stack, path + ".zarr", memory=int(sys.argv[2]), pooling="none",
                normals="least-squares", threads=1)
    peaks.append(peak_bytes())
print(json.dumps(peaks))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="counts memory as Linux does")
def test_a_large_picture_takes_the_memory_that_it_may(tmp_path: Path) -> None:
    lights = [(x, y, float(np.sqrt(1.0 - x * x - y * y))) for x, y in LAMPS]
    paths = []
    for side in SIDES:
        y, x = np.mgrid[:side, :side] / 9.0
        slopes = np.stack([0.2 * np.sin(x), 0.2 * np.cos(x + y), np.ones_like(x)])
        facing = np.tensordot(lights, slopes, 1) / np.linalg.norm(slopes, axis=0)
        paths.append(tmp_path / f"{side}.npy")
        np.save(paths[-1], np.rint(200.0 * facing).astype(np.uint8)[:, None])
        del y, x, slopes, facing
    done = processes.run(PROGRAM, json.dumps(lights), str(BUDGET), *map(str, paths))
    small, large = json.loads(done)
    # The small job has brought every library; the system counts pages of the mapped photographs
    # as the process's own. The same fit in memory grows by twice as much.
    mapped = paths[1].stat().st_size
    assert small < large <= small + BUDGET + mapped
