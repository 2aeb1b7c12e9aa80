"""Steps that Python cannot interrupt are left to themselves, not waited for."""

from __future__ import annotations

import _thread
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
import impasto._internal.waiting as waiting
from circumstances import capture
from impasto._internal.calls import thread_count
from impasto._internal.waiting import floats, wait_for, wait_for_each
from processes import run as run_program
from test_io_stack import save

PATIENCE = 60.0
"""Seconds that nothing here takes: after them a test fails instead of waiting for ever."""


@pytest.fixture
def heard() -> Iterator[None]:
    """Ctrl-C as Python has it; a shell's background job ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard")
def test_ctrl_c_leaves_a_step_in_the_middle() -> None:
    read, ended = threading.Event(), threading.Event()

    def step() -> None:
        assert threading.current_thread() is not threading.main_thread()
        _thread.interrupt_main()
        # Whoever waits for the step to end waits for himself.
        assert read.wait(PATIENCE)
        ended.set()

    with pytest.raises(KeyboardInterrupt):
        wait_for(step)
    assert not ended.is_set()
    read.set()
    assert ended.wait(PATIENCE)


@pytest.mark.parametrize("error", [ValueError("told"), TimeoutError("its own")])
def test_what_a_step_raises_is_raised(error: Exception) -> None:
    def step() -> None:
        raise error

    with pytest.raises(type(error)) as raised:
        wait_for(step)
    assert raised.value is error


def test_a_step_that_ends_as_the_wait_does_is_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    class Late(Future[str]):
        def result(self, timeout: float | None = None) -> str:
            found = super().result()
            if timeout is not None:
                raise TimeoutError
            return found

    monkeypatch.setattr(waiting, "Future", Late)
    assert wait_for(str, 17) == "17"


def test_a_thread_that_has_no_memory_to_begin_leaves_the_step_to_the_caller(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As ``start`` of a thread does not: it waits for ever (python/cpython#140746)."""
    begin = _thread.start_new_thread

    def ends_at_once(work: Any, given: Any) -> int:
        return begin(lambda *_: None, given)

    monkeypatch.setattr(_thread, "start_new_thread", ends_at_once)
    assert wait_for(threading.get_ident) == threading.main_thread().ident
    assert not waiting._UNDER_WAY


def test_a_thread_that_has_no_memory_for_its_end_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Full(Future[str]):
        def set_result(self, result: str) -> None:
            raise MemoryError

        def set_exception(self, exception: BaseException | None) -> None:
            raise MemoryError

    monkeypatch.setattr(waiting, "Future", Full)
    monkeypatch.setattr("sys.unraisablehook", lambda told: None)
    steps: list[int] = []
    with pytest.raises(MemoryError):
        wait_for(steps.append, 1)
    assert steps == [1], "and no step is taken twice"


def test_a_program_that_ends_waits_for_its_steps() -> None:
    program = (
        "import _thread, signal, sys, time\n"
        "from impasto._internal.waiting import wait_for\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def step():\n"
        "    _thread.interrupt_main()\n"
        "    time.sleep(0.5)\n"
        "    print('to its end', flush=True)\n"
        "try:\n"
        "    wait_for(step)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    assert run_program(program).split("\n") == ["interrupted", "to its end", ""]


def test_a_step_returns_and_keeps_the_callers_numpy() -> None:
    assert wait_for(divmod, 17, 5) == (3, 2)
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        wait_for(np.divide, 1.0, np.zeros(2))


def test_steps_side_by_side_return_in_the_order_of_their_items() -> None:
    together = threading.Barrier(2)

    def step(item: int) -> tuple[int, int | None]:
        together.wait(PATIENCE)  # nobody comes here alone
        return item, threading.get_ident()

    found = wait_for_each(step, range(4), 2)
    assert [item for item, _ in found] == [0, 1, 2, 3]
    assert len({thread for _, thread in found}) == 2
    assert threading.main_thread().ident not in {thread for _, thread in found}
    assert gone()


def test_on_one_thread_and_without_threads_the_caller_takes_all_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    main = threading.main_thread().ident
    assert wait_for_each(lambda _: threading.get_ident(), range(3), 1) == [main] * 3
    assert wait_for_each(lambda _: threading.get_ident(), range(1), 8) == [main]

    def full(*_: object) -> int:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(_thread, "start_new_thread", full)
    assert wait_for_each(lambda _: threading.get_ident(), range(3), 8) == [main] * 3


def test_the_first_error_of_steps_is_raised() -> None:
    def step(item: int) -> None:
        if item:
            raise ValueError(item)

    with pytest.raises(ValueError, match="1"):
        wait_for_each(step, range(3), 2)
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        wait_for_each(lambda one: np.divide(1.0, one), [np.ones(2), np.zeros(2)], 2)


def test_steps_without_memory_for_their_end_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(Future[Any]):
        def set_result(self, result: Any) -> None:
            raise MemoryError

        def set_exception(self, exception: BaseException | None) -> None:
            raise MemoryError

    monkeypatch.setattr(waiting, "Future", Full)
    taken = threading.Semaphore(0)
    with pytest.raises(MemoryError):
        wait_for_each(lambda _: taken.release(), range(2), 2)
    assert taken.acquire(timeout=PATIENCE)


def gone() -> bool:
    """Whether nothing is under way; what is known of a step outlives its result by a moment."""
    deadline = time.monotonic() + PATIENCE
    while waiting._UNDER_WAY and time.monotonic() < deadline:
        time.sleep(0.01)
    return not waiting._UNDER_WAY


@pytest.mark.usefixtures("heard")
def test_ctrl_c_leaves_steps_in_the_middle_and_begins_no_other() -> None:
    read, begun = threading.Event(), []

    def step(item: int) -> None:
        begun.append(item)
        if item == 1:
            _thread.interrupt_main()
        assert read.wait(PATIENCE)

    with pytest.raises(KeyboardInterrupt):
        wait_for_each(step, range(4), 2)
    read.set()
    assert gone()
    assert sorted(begun) == [0, 1]


def test_where_no_signal_comes_a_step_needs_no_thread() -> None:
    found: list[Any] = []
    caller = threading.Thread(target=lambda: found.append(wait_for(threading.current_thread)))
    caller.start()
    caller.join()
    assert found == [caller]


def test_only_other_numbers_are_copied() -> None:
    single = np.ones((3, 4), np.float32)
    assert floats(single) is single
    assert floats(np.float32(1.0)).shape == floats(1.0).shape == (1,)
    for other in (single.astype(np.float64), single.T, [[1, 2]]):
        copy = floats(other)
        assert copy.dtype == np.float32
        assert copy.flags.c_contiguous
        assert (copy == other).all()


@pytest.fixture
def waited(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the steps that were waited for, as they are taken."""
    names: list[str] = []

    def noted(step: Any, *args: Any, **options: Any) -> Any:
        names.append(step.__name__)
        return wait_for(step, *args, **options)

    for module in ("fit.segments", "fit.sbrdf", "fit.reflectance", "fit.result", "io.files"):
        monkeypatch.setattr(f"impasto.{module}.wait_for", noted)
    for module in ("io.session.codes", "io.session.photographs", "stack", "_internal.waiting"):
        monkeypatch.setattr(f"impasto.{module}.wait_for", noted)
    return names


def test_what_is_done_to_labels_and_maps_is_waited_for(waited: list[str]) -> None:
    stack = capture((48, 64)).stack
    height, width = stack.shape[2:]
    labels = (np.arange(width) * 2 // width) * np.ones((height, 1), int)
    found = impasto.fit_sbrdf(stack, pooling="segment", segments=labels, joint=False)
    # What belongs to the whole, then to each of two segments.
    once = ["checked_labels", "_samples_at", "_maps_of", "_known_labels"]
    each = ["equal", "_only", "_put"]
    assert waited == once + 2 * each
    assert [segment.own for segment in found.segments].count(True) > 0


EACH = ("open_picture", "read_region_into", "develop")
"""What is done to each photograph."""


def test_what_is_done_to_files_is_waited_for(waited: list[str], tmp_path: Path, data: Path) -> None:
    part = (0, 0, 32, 32)
    stack = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb", region=part)
    count = len(stack.rig)
    assert [waited.count(step) for step in EACH] == [count, count, count]
    small = stack[:8, :8]
    waited.clear()
    small.take([0, 2, 5, 9])  # copied before a thread has begun
    stack.take(range(0, count, 3))
    stereo = impasto.fit_normals(impasto.Stack(stack.samples.astype(np.float64), lights=stack.rig))
    assert waited == ["take", "contiguous"]
    waited.clear()
    impasto.fit_sbrdf(stack, normals=stereo, joint=False).save(tmp_path / "fit.npz")
    # The file, then its name.
    assert waited == ["fsync", "fsync"]


def test_what_is_done_to_files_of_a_filter_wheel_is_waited_for(
    waited: list[str], tmp_path: Path
) -> None:
    """Only the files of the first photograph tell its bands: they are decoded, then copied."""
    bands = ("420", "590")
    for name in ("a", "b", "c"):
        for band in bands:
            save(tmp_path / f"{name}_{band}.tif", np.ones((1, 4, 4), np.uint16))
    lights = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8]])
    impasto.read_stack(tmp_path, lights=lights, pattern="{name}_{band}.tif", encoding="linear")
    count = 3 * len(bands)
    first = len(bands)
    assert waited.count("open_picture") == count
    assert waited.count("read_region") == first
    assert waited.count("copyto") == 1
    assert waited.count("read_region_into") == count - first


@pytest.mark.parametrize(
    ("threads", "steps", "each", "nested"),
    [(1, 3, 1, 1), (2, 3, 1, 1), (3, 2, 1, 1), (4, 2, 4, 1), (8, 2, 8, 8), (8, 1, 8, 8)],
)
def test_steps_side_by_side_share_the_threads(
    threads: int, steps: int, each: int, nested: int
) -> None:
    """One each, unless there are two for each of them; ``nested``: of two in each."""

    def two(_: int) -> list[int]:
        return wait_for_each(lambda _: thread_count(threads), range(2), thread_count(threads))

    assert wait_for_each(lambda _: thread_count(threads), range(steps), threads) == [each] * steps
    assert wait_for_each(two, range(steps), threads) == [[nested] * 2] * steps
    assert thread_count(threads) == threads


@pytest.mark.parametrize("threads", [1, 2])
def test_the_caller_hears_of_each_step(threads: int) -> None:
    callers = list[int]()
    wait_for_each(str, range(5), threads, lambda: callers.append(threading.get_ident()))
    assert callers == [threading.get_ident()] * 5
