"""What is on the disk when a call returns: the steps of the system are those that are taken."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import pytest

from failing_steps import Steps, counted
from impasto.io.files import atomic_together
from impasto.io.json_lines import JournalFile, read_lines

pytestmark = pytest.mark.skipif(os.name != "posix", reason="folders are flushed on POSIX systems")
PATIENCE = 60.0
"""Seconds that nothing here takes."""


def flushed_folders(folder: Path, files: dict[Path, bytes]) -> list[str]:
    """The folders that a call flushes, each as often as it does; ``""``: the one given."""
    with counted(Steps(folder)) as steps:
        atomic_together(files)
    assert {path: path.read_bytes() for path in files} == files
    flushes = (step.removeprefix("fsync ") for step in steps.taken if step.startswith("fsync "))
    # A point stands for a temporary file.
    return sorted(name for name in flushes if not name.endswith("."))


def test_the_names_of_new_folders_are_on_the_disk_with_those_of_their_files(tmp_path: Path) -> None:
    """The first tile of a store makes folders in folders, and the next row one of these."""
    first = {tmp_path / f"{name}/c/0/0/0": b"one" for name in ("normal", "diffuse")}
    own = [f"{name}{end}" for name in ("diffuse", "normal") for end in ("", "/c", "/c/0", "/c/0/0")]
    assert flushed_folders(tmp_path, first) == ["", *own]
    beside = {tmp_path / "normal/c/0/0/1": b"two"}
    assert flushed_folders(tmp_path, beside) == ["normal/c/0/0"], "nothing was made"
    below = {tmp_path / "normal/c/0/1/0": b"three"}
    assert flushed_folders(tmp_path, below) == ["normal/c/0", "normal/c/0/1"]


def test_a_flush_that_ctrl_c_leaves_keeps_the_file_of_its_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journal is closed then: its handle may be that of another file by now."""
    journal = JournalFile(tmp_path / "journal.jsonl", 0, {"job": "a"})
    closed, ended = threading.Event(), threading.Event()
    fsync, same = os.fsync, []

    def slow(handle: int) -> None:
        signal.raise_signal(signal.SIGINT)
        assert closed.wait(PATIENCE)
        try:
            with (tmp_path / "other").open("wb"):  # takes the lowest number that is free
                same.append(os.path.samestat(os.fstat(handle), journal.path.stat()))
            fsync(handle)
        finally:
            ended.set()

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
    try:
        monkeypatch.setattr(os, "fsync", slow)
        with pytest.raises(KeyboardInterrupt):
            journal.append({"tile": 1})
        journal.close()
        closed.set()
        assert ended.wait(PATIENCE)
    finally:
        signal.signal(signal.SIGINT, before)
    assert same == [True]
    lines: list[dict[str, object]] = []
    read_lines(journal.path, lambda content, _: lines.append(content))
    assert lines == [{"job": "a"}, {"tile": 1}]
