"""Memory that nobody has any more goes back to the system, whichever thread had it."""

from __future__ import annotations

import platform

import pytest

import processes

THREADS = """
import ctypes, threading
from impasto._internal.heap import give_back

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
libc.free.argtypes = [ctypes.c_void_p]
MEMORY, PIECE = 64 << 20, 64 << 10  # pieces too small to be mapped each

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

def use():
    pieces = [libc.malloc(PIECE) for _ in range(MEMORY // PIECE)]
    for piece in pieces:
        ctypes.memset(piece, 1, PIECE)
    # The last one stays, so that the others are no end of the heap, which free() gives back.
    for piece in pieces[:-1]:
        libc.free(piece)

before = resident()
thread = threading.Thread(target=use)
thread.start()
thread.join()
kept = resident() - before
give_back()
print(kept, resident() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="heaps of glibc")
def test_what_a_thread_has_freed_goes_back_to_the_system() -> None:
    kept, left = map(int, processes.run(THREADS).split())
    # Else there is nothing to give back: glibc keeps all but a little of the 64 MiB.
    assert kept > 48 << 20
    # The piece that stays and the pages around it; what the interpreter takes meanwhile.
    assert left < 4 << 20
