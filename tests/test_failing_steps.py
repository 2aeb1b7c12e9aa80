"""Steps of the system that fail once; ``failing_steps.py`` lets every one of them fail."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

import failing_steps
from impasto.cli import main
from impasto.io import write_stack

pytest.importorskip("fcntl", reason="jobs need POSIX")
pytestmark = pytest.mark.slow

EVERY = {"run": 200, "ingest": 60, "save": 150, "learned": 30, "export": 150}
"""Of so many steps one fails; of the last one's neighbours none. The others have ten steps."""


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Callable[[Path], object]]:
    return failing_steps.calls(tmp_path_factory.mktemp("calls"))


KINDS = (
    *("run .zarr", "ingest .zarr", "save .zarr", "save .npz", "learned .npz", "export .crate"),
    *("height .tif", "render .tif"),
)


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_that_fails_is_told_and_leaves_nothing_half(
    kind: str, known: dict[str, Callable[[Path], object]], tmp_path: Path
) -> None:
    assert tuple(known) == KINDS
    name, suffix = kind.split()
    seen = failing_steps.tried(known[kind], suffix, tmp_path, EVERY.get(name, 1))
    assert seen.faults == []
    assert seen.endings["the error"] >= 2
    assert seen.ignored.keys() <= {"mkdir", "link", "unlink", "rmdir"}


def test_what_is_half_or_left_is_seen(tmp_path: Path) -> None:
    """The check can fail: a writer that does without temporary files."""

    def careless(out: Path) -> None:
        out.with_name(".left").write_bytes(b"1")
        with out.open("wb", buffering=0) as file:
            file.write(b"one")
            file.write(b"two")
            os.fsync(file.fileno())
        out.with_name(".left").unlink()

    seen = failing_steps.tried(careless, ".x", tmp_path)
    # Opening, writing, (flushing with the end of the file); opening, two writes, fsync, unlink.
    assert seen.steps == 7
    words = " ".join(seen.faults)
    assert "something is there that is not whole" in words
    assert "is left: ['.left']" in words
    assert "about None" in words


@pytest.mark.parametrize(("failing", "expected"), [(3, 1), (300, 4)])
def test_a_full_disk_is_a_line_of_the_command_line(
    failing: int, expected: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before there is anything to resume, and after."""
    write_stack(tmp_path / "stack.npz", failing_steps.stack())
    out = tmp_path / "out" / "a.zarr"
    out.parent.mkdir()
    words = ["job", "run", str(tmp_path / "stack.npz"), "--out", str(out), "--tile", "16"]
    words += ["--pooling", "none", "--threads", "1"]
    with failing_steps.counted(failing_steps.Steps(out.parent, failing, errno.ENOSPC)) as steps:
        assert main(words) == expected
    assert steps.failed
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert "no space left on device" in told.lower()
    assert f"{out}.partial" in "".join(told.split("\n"))
    assert ("impasto job resume" in told) is (expected == 4)
    assert main(words if expected == 1 else ["job", "resume", str(out)]) == 0
    assert main(["job", "verify", str(out)]) == 0
