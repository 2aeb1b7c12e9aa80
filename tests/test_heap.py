"""One heap for all threads, as glibc itself counts them."""

from __future__ import annotations

import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

THREADS = """
import ctypes, sys, threading
from impasto._internal.heap import share_one_heap

libc = ctypes.CDLL(None)
libc.malloc.restype = libc.fopen.restype = ctypes.c_void_p
if sys.argv[2] == "one":
    share_one_heap()
together = threading.Barrier(3)

def take():
    assert libc.malloc(1000)
    together.wait()  # else one thread could have the heap of another that has ended

threads = [threading.Thread(target=take) for _ in range(3)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
file = ctypes.c_void_p(libc.fopen(sys.argv[1].encode(), b"w"))
assert libc.malloc_info(0, file) == 0
libc.fclose(file)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="heaps of glibc")
@pytest.mark.parametrize(("how", "heaps"), [("own", 4), ("one", 1)])
def test_threads_share_one_heap(how: str, heaps: int, tmp_path: Path) -> None:
    report = tmp_path / "malloc.xml"
    # Each of the libraries that a process loads may begin threads; NumPy's must not count here.
    environment = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", THREADS, str(report), how]
    subprocess.run(command, check=True, env=environment, timeout=60)
    assert len(re.findall("<heap nr=", report.read_text())) == heaps
