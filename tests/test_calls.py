"""The circumstances of a call change no bit: threads, company, instruction sets, memory layout.

And a call can be watched, stopped, interrupted and made after a fork.
"""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from circumstances import CALLS, FEW, LONG, capture, digests, keep, kept
from processes import run, surroundings

CALL = pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)


@pytest.fixture(scope="module")
def photographed() -> Any:
    return capture()


@pytest.fixture(scope="module")
def file(photographed: Any, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The same for other processes."""
    return str(keep(tmp_path_factory.mktemp("capture") / "photographed", photographed))


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Photographs of few pixels for other processes."""
    return str(keep(tmp_path_factory.mktemp("capture") / "few", capture(FEW)))


@pytest.fixture(scope="module")
def expected(photographed: Any) -> dict[str, str]:
    """The digest of every call on one thread."""
    return digests(photographed, threads=1)


@pytest.mark.parametrize("threads", [2, 3, 5, 8])
def test_any_number_of_threads_gives_the_same_bits(
    photographed: Any, expected: dict[str, str], threads: int
) -> None:
    assert digests(photographed, threads) == expected


def test_calls_at_the_same_time_give_the_same_bits(
    photographed: Any, expected: dict[str, str]
) -> None:
    with ThreadPoolExecutor(4) as pool:
        # Pools of different sizes replace each other under the calls that use them.
        found = list(pool.map(lambda n: digests(photographed, n), (2, 3, 1, 2)))
    assert found == [expected] * 4


@pytest.fixture(scope="module")
def expected_of_few(few: str) -> dict[str, str]:
    return digests(kept(few), threads=1)


@pytest.mark.parametrize("level", ["baseline", "avx2", "avx512"])
def test_every_instruction_set_gives_the_same_bits(
    level: str, few: str, expected_of_few: dict[str, str]
) -> None:
    # A level that this processor lacks falls back to the best there is.
    program = "import sys, circumstances as c; print(c.digests(c.kept(sys.argv[1]), threads=2))"
    assert ast.literal_eval(run(program, few, IMPASTO_SIMD=level)) == expected_of_few


@CALL
def test_progress_rises_to_its_total(photographed: Any, call: Any) -> None:
    seen: list[tuple[int, int]] = []
    call(photographed, threads=2, progress=lambda done, total: seen.append((done, total)))
    assert seen == sorted(seen)
    assert all(done <= total for done, total in seen)
    done, total = seen[-1]
    assert done == total > 0


class EnoughError(Exception):
    """What a caller's own progress function may raise."""


@CALL
def test_an_exception_in_progress_reaches_the_caller(photographed: Any, call: Any) -> None:
    seen = []

    def stop(done: int, total: int) -> None:
        seen.append((done, total))
        raise EnoughError

    with pytest.raises(EnoughError):
        call(photographed, threads=2, progress=stop)
    assert len(seen) == 1, "nobody is asked again after saying stop"
    # The next call is none the worse.
    call(photographed, threads=2)


FORK = """
import os, sys
from circumstances import digests, kept

photographed = kept(sys.argv[1])
before = digests(photographed, threads=2)
child = os.fork()
if child == 0:
    same = all(digests(photographed, threads=n) == before for n in (2, 3))
    os._exit(0 if same else 1)
_, status = os.waitpid(child, 0)
assert digests(photographed, threads=2) == before
sys.exit(os.waitstatus_to_exitcode(status))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_child_may_call_with_threads_after_its_parent_did(few: str) -> None:
    # A child that waits for threads of its parent waits for ever: `run` would time out.
    run(FORK, few)


FORK_DURING_CALLS = """
import os, sys, threading, time
import numpy as np
import impasto
from circumstances import LONG, kept

photographed = kept(sys.argv[1])
normal = np.zeros((3, 8, 8), np.float32)
normal[2] = 1.0
inside, stop = threading.Event(), threading.Event()

def watch(done, total):
    if done < total:
        inside.set()

def work():
    while not stop.is_set():
        LONG["predict"](photographed, threads=2, progress=watch)

worker = threading.Thread(target=work)
worker.start()
failed = 0
for _ in range(20):
    inside.clear()
    assert inside.wait(60.0)
    child = os.fork()
    if child == 0:
        for threads in (2, 3):
            impasto.integrate_normals(normal, threads=threads)
        os._exit(0)
    patience = time.monotonic() + 60.0
    while not (done := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > patience:
            os.kill(child, 9)
            done = os.waitpid(child, 0)
            break
        time.sleep(0.001)
    if done[1]:
        print("the child ended with", done[1], file=sys.stderr)
        failed = 1
        break
stop.set()
worker.join()
sys.exit(failed)
"""


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_child_forked_while_another_thread_is_in_a_call_may_call(file: str) -> None:
    """It inherits the locks that this thread holds, not the thread that would release them.

    The fork falls into the middle of a call. One that falls into the start of a thread may leave
    glibc's own tables of the child half changed (2.36: thread-local memory of libraries loaded by
    dlopen is freed twice), in programs without impasto too; no library can prevent that.
    """
    run(FORK_DURING_CALLS, file)


POOL = """
import multiprocessing, sys
from circumstances import digests, kept

photographed = kept(sys.argv[1])
before = digests(photographed, threads=2)

def again(threads):
    return digests(photographed, threads) == before

with multiprocessing.get_context("fork").Pool(2) as pool:
    assert all(pool.map(again, [1, 2, 3, 2]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_multiprocessing_may_fork_after_a_call_with_threads(few: str) -> None:
    run(POOL, few)


CHILD = """
import multiprocessing
import impasto
from failing_steps import stack

def fitted(threads):
    return impasto.fit_sbrdf(stack(), pooling="none", threads=threads).diffuse.tobytes()

if __name__ == "__main__":
    before = fitted(2)
    for method in ("spawn", "forkserver"):
        with multiprocessing.get_context(method).Pool(1) as pool:
            assert pool.apply_async(fitted, (3,)).get(60.0) == before
"""


@pytest.mark.slow
def test_a_child_that_begins_anew_gives_the_same_bits(tmp_path: Path) -> None:
    """It imports the program of its parent, which therefore is a file."""
    program = tmp_path / "program.py"
    program.write_text(CHILD)
    words = [sys.executable, str(program)]
    done = subprocess.run(words, env=surroundings(), stderr=subprocess.PIPE, timeout=120)
    assert done.returncode == 0, done.stderr.decode()


INTERRUPTED = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
from circumstances import CALLS, LONG, kept

photographed = kept(sys.argv[3])
reports = []

def watch(done, total):
    reports.append((done, total))
    if len(reports) == int(sys.argv[2]):
        print("started", flush=True)

try:
    while True:  # on a busy machine the signal may come after the first call's end
        LONG[sys.argv[1]](photographed, threads=1, progress=watch)
except KeyboardInterrupt:
    print("interrupted", *reports[-1], flush=True)
    CALLS[sys.argv[1]](photographed, threads=2)
    print("well", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="SIGINT is sent as on POSIX")
@pytest.mark.parametrize("name", LONG)
def test_ctrl_c_stops_a_call_in_the_middle(name: str, file: str) -> None:
    # A signal that falls between two stages stops the call all the same, but it does not show
    # that a stage can be stopped: send another, after more reports, in another stage maybe.
    for reports in (1, 3, 6, 10):
        done, total, waited = interrupted(name, reports, file)
        # A heartbeat of 50 ms and one tile; the rest of the second is for a busy machine.
        assert waited < 1.0
        if done < total:
            return
    pytest.fail(f"four signals, and each time all {total} tiles were done")


def interrupted(name: str, reports: int, file: str) -> tuple[int, int, float]:
    """Tiles done, tiles in all, and seconds from the signal to the end of a call.

    The signal is sent after so many reports of progress.
    """
    # The slowest instruction set makes the longest call.
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, name, str(reports), file],
        env=surroundings(IMPASTO_SIMD="baseline"),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        word, done, total = process.stdout.readline().split()
        waited = time.monotonic() - begin
        assert process.communicate(timeout=60)[0] == "well\n"
    finally:
        process.kill()
        process.wait()
    assert word == "interrupted"
    return int(done), int(total), waited
