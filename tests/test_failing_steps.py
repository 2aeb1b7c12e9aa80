"""Steps of the system that fail once; ``failing_steps.py`` lets every one of them fail."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

import failing_steps
import impasto
from impasto import simulate
from impasto.cli import main
from impasto.cli.codes import Exit
from impasto.io import write_stack

pytest.importorskip("fcntl", reason="jobs need POSIX")
pytestmark = pytest.mark.slow

EVERY = {
    "run": 480,
    "resume": 480,
    "merge": 800,
    "ingest": 80,
    "save": 230,
    "learned": 30,
    "export": 160,
    "render": 5,
}
"""Of so many steps one fails, and the first three and last four; all ten of a height."""


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, failing_steps.Call]:
    return failing_steps.calls(tmp_path_factory.mktemp("calls"))


KINDS = (
    *(
        "run .zarr",
        "resume .zarr",
        "merge .zarr",
        "ingest .zarr",
        "save .zarr",
        "save .npz",
        "learned .npz",
    ),
    *("export .crate", "height .tif", "render .tif"),
)


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_that_fails_is_told_and_leaves_nothing_half(
    kind: str, known: dict[str, failing_steps.Call], tmp_path: Path
) -> None:
    assert tuple(known) == KINDS
    name, suffix = kind.split()
    seen = failing_steps.tried(known[kind], suffix, tmp_path, EVERY.get(name, 1))
    assert seen.faults == []
    assert seen.endings["the error"] >= 1
    assert seen.endings["not reached"] <= 1, "steps at the end are found by what they are"
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

    seen = failing_steps.tried(failing_steps.Call(careless), ".x", tmp_path)
    # Opening, writing, (flushing with the end of the file); opening, two writes, fsync, unlink.
    assert seen.steps == 7
    words = " ".join(seen.faults)
    assert "something is there that is not whole" in words
    assert "is left: ['.left']" in words
    assert "about None" in words


def test_a_full_disk_before_there_is_a_job_is_a_line_of_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Later there is one to resume (``test_cli_job.py``)."""
    write_stack(tmp_path / "stack.npz", failing_steps.stack())
    out = tmp_path / "out" / "a.zarr"
    out.parent.mkdir()
    words = ["job", "run", str(tmp_path / "stack.npz"), "--out", str(out), "--tile", "16"]
    words += ["--pooling", "none", "--threads", "1"]
    with failing_steps.counted(failing_steps.Steps(out.parent, 3, errno.ENOSPC)) as steps:
        assert main(words) == 1
    assert steps.failed
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert "no space left on device" in told
    assert f"{out}.partial" in "".join(told.split("\n"))
    assert main(words) == 0


def test_a_merge_that_a_full_disk_ends_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    painting = simulate.default_capture("tominaga-rgb-camera", size=(64, 112)).stack
    whole = impasto.fit_sbrdf(painting, pooling="none", check=False)
    frames = [tmp_path / "left.npz", tmp_path / "right.npz"]
    for frame, columns in zip(frames, (slice(72), slice(40, None)), strict=True):
        whole[:, columns].save(frame)
    out = tmp_path / "out" / "a.zarr"
    out.parent.mkdir()
    words = ["job", "merge", *map(str, frames), "--out", str(out), "--tile", "64"]
    with failing_steps.counted(failing_steps.Steps(out.parent, 100, errno.ENOSPC)) as steps:
        assert main(words) == Exit.PARTIAL
    assert steps.failed
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert "no space left on device" in told
    assert "go on with the same command" in told
    assert main(words) == Exit.OK
