"""What stands beside a bar."""

from __future__ import annotations

import pytest
from rich.console import Console
from rich.progress import Progress, Task

from impasto._internal.bars import Remaining, memory_words, time_words

on_linux = pytest.mark.skipif(not memory_words(), reason="this system does not say its memory")


def task(seconds: float, **fields: str | bool) -> Task:
    """Of a hundred pieces ten are done after so many seconds, at an even pace."""
    now = 0.0
    progress = Progress(console=Console(quiet=True), get_time=lambda: now)
    one = progress.add_task("work", total=100, **fields)
    for done in range(11):
        now = seconds * done / 10
        progress.update(one, completed=done)
    return progress.tasks[0]


@on_linux
def test_long_work_says_its_time_left_and_its_memory() -> None:
    words = Remaining().render(task(20.0, whole=True)).plain
    # Ten pieces take 20 s: ninety take 180.
    assert words.startswith("3 min left, ")
    assert words.endswith(" GiB")


def test_short_work_says_nothing() -> None:
    assert Remaining().render(task(1.0)).plain == ""


@on_linux
def test_work_that_is_not_counted_as_a_whole_does_not_know_its_time() -> None:
    words = Remaining().render(task(20.0)).plain
    assert "left" not in words
    assert words.endswith(" GiB")


def test_words_of_its_own_come_first() -> None:
    assert Remaining().render(task(20.0, words="registering")).plain == "registering"


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.4, "0 s"), (89.0, "89 s"), (90.0, "2 min"), (5300.0, "88 min"), (11100.0, "3 h 05 min")],
)
def test_times_in_words(seconds: float, words: str) -> None:
    assert time_words(seconds) == words


@on_linux
def test_memory_is_that_of_this_process() -> None:
    # Python with numpy takes tens of MB, and no test as much as the machine has.
    assert 0.0 < float(memory_words().removesuffix(" GiB")) < 64.0
