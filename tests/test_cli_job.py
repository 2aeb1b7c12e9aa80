"""``impasto job``: run, look, verify and resume on the command line."""

from __future__ import annotations

import errno
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import impasto
from command_line import complaint
from impasto import jobs
from impasto._internal import regular
from impasto.cli import main
from impasto.cli.job import terminated_as_interrupted
from impasto.io import write_lights, write_stack, write_tiff16
from impasto.jobs.cluster import LOST
from interrupted_jobs import interrupting
from job_photographs import photographs
from killed_jobs import stack, tree
from processes import surroundings

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stack") / "painting.npz"
    write_stack(path, stack())
    return path


def job(source: Path, out: Path, *words: str) -> list[str]:
    return [
        "job",
        "run",
        str(source),
        "--out",
        str(out),
        "--pooling",
        "none",
        "--tile",
        "32",
        *words,
    ]


def interrupted(source: Path, out: Path, after: int) -> None:
    """After two tiles or more."""
    with interrupting(after) as stop:
        impasto.run(source, out, pooling="none", tile=32, progress=stop)


def test_a_job_from_beginning_to_end(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "painting.impasto.zarr"
    assert main(job(source, out)) == 0
    told = capsys.readouterr().err
    assert "9 of 9, 0.0063 Mpx" in told
    # The command that the last line names makes a picture.
    command = shlex.split(told.splitlines()[-1].split("pictures: ")[1])
    command[-1] = str(tmp_path / "raking.png")
    assert main([*command[1:], "--quiet"]) == 0
    assert (tmp_path / "raking.png").is_file()
    assert main(["job", "status", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["state"], found["tiles_done"], found["pixels"]) == ("finished", 9, 6300)
    assert main(["job", "verify", str(out)]) == 0
    assert "all files are as written and all inputs as read" in capsys.readouterr().out
    assert main(["job", "rerun", str(out), "--into", str(tmp_path / "b.zarr"), "--quiet"]) == 0
    assert "the same bytes as" in capsys.readouterr().out
    assert main(["info", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["size"] == "90 x 70 pixels, 3 bands"
    # No lobe was looked for: nothing is said of its strength or width.
    assert told["gloss"] == "not fitted"
    assert not {"verdict", "beta", "gamma_degrees"} & told.keys()
    picture = tmp_path / "above.png"
    assert main(["render", str(out), "--out", str(picture), "--quiet"]) == 0
    assert picture.is_file()


def test_an_interrupted_job_says_how_to_go_on(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "painting.zarr"
    interrupted(source, out, 4)
    assert main(["job", "status", str(out)]) == 0
    page = capsys.readouterr().out
    assert "interrupted" in page
    assert "4 of 9, " in page
    assert f"impasto job resume {out}" in page
    assert "\nmodel       photometric stereo alone\n" in page
    assert main(["job", "verify", str(out)]) == 4
    assert "as written, 4 of 9 tiles" in capsys.readouterr().out
    assert main(["job", "resume", str(out), "--quiet"]) == 0
    assert main(job(source, tmp_path / "whole.zarr", "--quiet")) == 0
    assert tree(out) == tree(tmp_path / "whole.zarr")


def test_the_sample_that_a_model_is_learned_from_is_told(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With less memory it is smaller, and the model is another."""
    out = tmp_path / "painting.zarr"
    assert main(job(source, out, "--sample", "3", "--quiet")) == 0
    assert jobs.status(out).sample == 3
    assert main(["job", "status", str(out)]) == 0
    assert "\nlearned     from one row and column in 3 (--memory, --sample)\n" in (
        capsys.readouterr().out
    )


@pytest.mark.parametrize(
    "words",
    [
        "info {out}",
        "doctor {out}",
        "render {out} --out {png}",
        "height {out} --out {png}.tif",
        "view {out}",
        "export iiif {out} --out {png}",
        "compare {out} {out}",
        "job merge {out} {out} --out {png}.zarr",
    ],
)
def test_a_store_that_is_not_finished_is_told_from_none(
    words: str, unfinished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # By the name that it will have, and by the one that a shell completes.
    for name in (unfinished, unfinished.with_name(unfinished.name + ".partial")):
        filled = words.format(out=name, png=tmp_path / "made.png").split()
        said = complaint(filled, 1, capsys)
        assert f"{unfinished} is not finished" in said
        assert f"impasto job resume {unfinished}" in said
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def unfinished(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("job") / "painting.zarr"
    interrupted(source, out, 4)
    return out


def test_photographs_in_a_store_are_described_and_are_no_result(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "painting.stack.zarr"
    assert main(["ingest", str(source), "--out", str(store), "--quiet"]) == 0
    assert main(["info", str(store), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["photographs"] == f"{len(stack().rig)} of 90 x 70 pixels, 3 bands"
    assert found["inputs"] == str(source)
    render = ["render", str(store), "--out", str(tmp_path / "x.png")]
    assert "photographs, not the result of a fit" in complaint(render, 3, capsys)


SLOW_TILES = (
    "import signal, sys, time, impasto.jobs.tiles as tiles\n"
    "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"  # these tests may run under nohup
    "fitted = tiles.fitted\n"
    "def slow(*given):\n    time.sleep(0.2)\n    return fitted(*given)\n"
    "tiles.fitted = slow\n"
    "from impasto.cli import main\n"
    "sys.exit(main(sys.argv[1:]))"
)
"""Every tile takes a while, so that a job is surely running when it is looked at."""


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGHUP])
def test_a_running_job_is_seen_and_ended_from_outside(
    end: signal.Signals, source: Path, tmp_path: Path
) -> None:
    """As by a batch system or a terminal: exit code 130, the command that goes on, a journal."""
    out = tmp_path / "painting.zarr"
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_TILES, *job(source, out)],
        env=surroundings(),
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        found = None
        deadline = time.monotonic() + 60
        while (found is None or found.tiles_done < 1) and time.monotonic() < deadline:
            time.sleep(0.05)
            if (tmp_path / "painting.zarr.partial" / "job" / "job.json").exists():
                found = jobs.status(out)
        assert found is not None
        assert (found.state, found.process) == ("running", process.pid)
        os.kill(process.pid, end)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130
    assert f"go on with: impasto job resume {out}" in said
    assert "Traceback" not in said
    assert jobs.verify(out) == ()
    assert jobs.status(out).state == "interrupted"


def test_a_terminal_that_closes_ends_a_job_as_ctrl_c_does(source: Path, tmp_path: Path) -> None:
    """The bar of a job cannot be drawn to its end there."""
    out = tmp_path / "painting.zarr"
    ours, theirs = os.openpty()

    def take_terminal() -> None:
        import fcntl
        import termios

        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_TILES, *job(source, out)],
        env=surroundings(),
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
        preexec_fn=take_terminal,
    )
    os.close(theirs)
    try:
        shown = b""
        while b"1 of 9" not in shown:
            shown += os.read(ours, 4096)
        os.close(ours)
        assert process.wait(timeout=60) == 130
    finally:
        process.kill()
        process.wait()
    assert jobs.verify(out) == ()
    assert jobs.status(out).state == "interrupted"


def test_a_full_disk_ends_with_a_job_to_resume(
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out, flush, steps = tmp_path / "painting.zarr", os.fsync, []

    def full(handle: int) -> None:
        steps.append(handle)
        if len(steps) > 100:
            raise OSError(28, os.strerror(28))
        flush(handle)

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        assert main(job(source, out)) == 4
    said = capsys.readouterr().err
    assert "no space left on device" in said
    assert f"impasto job resume {out}" in said
    assert "Traceback" not in said
    assert main(["job", "resume", str(out), "--quiet"]) == 0


@pytest.mark.parametrize("call", ["open", "read"])
def test_photographs_whose_disk_fails_end_with_a_job_to_resume(
    call: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, out, fit = photographs(tmp_path), tmp_path / "painting.zarr", jobs.job.fit_tiles
    unplugged = False

    class OfADisk(regular.Handle):
        def __init__(self, *given: Any, **options: Any) -> None:
            if unplugged and call == "open":
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            super().__init__(*given, **options)

        def seek(self, *place: int) -> int:
            if unplugged and call == "read":
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            return super().seek(*place)

    def unplug(*given: Any, **options: Any) -> None:
        nonlocal unplugged
        unplugged = True
        fit(*given, **options)

    few = ["--memory", "1MB", "--sample", "1"]
    with monkeypatch.context() as patched:
        patched.setattr(regular, "Handle", OfADisk)
        patched.setattr("impasto.jobs.job.fit_tiles", unplug)
        assert main(job(path, out, *few)) == 4
    said = capsys.readouterr().err
    problem = "No such device" if call == "open" else "Input/output error"
    assert f".tif: cannot be read ({problem})" in said
    assert f"go on with: impasto job resume {out}\n" in said
    assert "Traceback" not in said
    # A name that is wrong is an error of the call, though there is a job to resume.
    wrong = job(path, out, *few, "--mask", str(tmp_path / "nowhere.png"))
    assert "nowhere.png" in complaint(wrong, 1, capsys)
    assert main(["job", "resume", str(out), "--quiet"]) == 0


def test_a_job_without_memory_says_how_to_take_less(
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "painting.zarr"

    def no_room(*_: object, **__: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr("impasto.jobs.job.open_photographs", no_room)
        said = complaint(job(source, out, "--quiet", "--memory", "3GiB"), 1, capsys)
        assert said.endswith("not enough memory: give less than 3GiB, such as --memory 1536MiB")
        patched.setattr(jobs, "ingest", no_room)
        words = ["ingest", str(source), "--out", str(tmp_path / "stack.zarr"), "--memory", "2MiB"]
        assert complaint(words, 1, capsys).endswith("less than 2MiB, such as --memory 1MiB")
    with monkeypatch.context() as patched:
        patched.setattr("impasto.jobs.job.fit_tiles", no_room)
        assert main(job(source, out)) == 4
    said = capsys.readouterr().err
    assert "begin anew with smaller tiles (impasto job run --no-resume --tile)" in said
    assert f"go on with: impasto job resume {out} --memory 2048MiB" in said
    assert "--region" not in said
    assert main(["job", "resume", str(out), "--quiet", "--memory", "2048MiB"]) == 0


def test_missing_photographs_make_a_result_partial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = stack()
    names = [f"light{index}.tif" for index in range(len(taken.rig))]
    for name, codes in zip(names[1:], taken.samples[1:], strict=True):
        write_tiff16(tmp_path / name, codes << 4)
    write_lights(tmp_path / "dirs.lp", taken.rig, names)
    out = tmp_path / "painting.zarr"
    assert main(job(tmp_path / "dirs.lp", out)) == 4
    said = capsys.readouterr().err
    assert "light0.tif" in said
    assert "listed photographs are missing" in said
    # Before the tiles, not after the last one; once.
    assert said.count("light0.tif") == 1
    assert said.index("light0.tif") < said.index("\n  tiles ")
    assert ("missing",) in {note[:1] for note in jobs.status(out).notes}
    assert main(["job", "status", str(out)]) == 0
    assert "\nnote        " in capsys.readouterr().out
    assert jobs.verify(out) == ()


def test_a_name_that_is_nearly_that_of_a_job_is_told(
    unfinished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("painting", "paintin.zarr", "painting.zar"):
        said = complaint(["job", "status", str(unfinished.with_name(name))], 1, capsys)
        assert said.rstrip().endswith("did you mean 'painting.zarr'?"), name
    said = complaint(["job", "status", str(unfinished.with_name("icon.zarr"))], 1, capsys)
    assert "did you mean" not in said


def test_less_memory_than_the_tiles_of_a_job_need_is_told(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Tiles keep their size, whatever memory there is now."""
    out = tmp_path / "painting.zarr"
    interrupted(source, out, 4)
    capsys.readouterr()
    assert main(["job", "resume", str(out), "--memory", "1"]) == 0
    said = capsys.readouterr().err
    assert "memory: the tiles of this job keep their 32 x 32 pixels, for which it takes" in said
    assert "impasto job run --no-resume --tile" in said


def test_changes_are_listed(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "painting.zarr"
    impasto.run(source, out, pooling="none", tile=64)
    shard = out / "normal" / "c" / "0" / "1" / "1"
    data = bytearray(shard.read_bytes())
    data[5] ^= 4
    shard.write_bytes(data)
    assert main(["job", "verify", str(out), "--no-inputs"]) == 3
    captured = capsys.readouterr()
    assert captured.out.startswith(f"{shard}: has changed")
    assert "1 file is not as written or read" in captured.err
    assert f"mv {out} {out}.partial && impasto job resume {out}" in captured.err
    assert main(["job", "rerun", str(out), "--into", str(tmp_path / "b.zarr"), "--quiet"]) == 3
    said = capsys.readouterr()
    assert said.out == "normal/c/0/1/1\n"
    assert f"1 file differs between {tmp_path / 'b.zarr'} and {out}" in said.err
    assert f"impasto job verify {out}" in said.err
    assert main(["info", str(out)]) == 3


def test_files_of_others_are_moved_away_and_photographs_restored(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "painting.zarr"
    impasto.run(source, out, pooling="none", tile=64)
    (out / ".DS_Store").write_bytes(b"")
    assert main(["job", "verify", str(out), "--no-inputs"]) == 3
    said = capsys.readouterr().err
    assert "put there by others: move it away" in said
    assert "job resume" not in said
    (out / "normal" / "c" / "0" / "1" / "1").unlink()
    assert main(["job", "verify", str(out), "--no-inputs"]) == 3
    said = capsys.readouterr().err
    assert "move it away" in said
    assert f"impasto job resume {out}" in said


def test_another_version_is_not_told_to_repair(
    source: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "painting.zarr"
    monkeypatch.setattr("impasto.jobs.job.build_name", lambda: "0.0.9+0123456789ab")
    impasto.run(source, out, pooling="none", tile=64)
    (out / "normal" / "c" / "0" / "1" / "1").unlink()
    assert main(["job", "verify", str(out), "--no-inputs"]) == 3
    said = capsys.readouterr().err
    assert "impasto 0.0.9+0123456789ab, which made them, makes them again" in said
    assert "job resume" not in said


def test_ctrl_c_while_photographs_are_hashed_says_that_nothing_is_kept(
    source: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("impasto.jobs.job.open_photographs", interrupt)
    assert main(job(source, tmp_path / "painting.zarr")) == 130
    assert "nothing was kept yet; give the same command again" in capsys.readouterr().err
    monkeypatch.undo()
    out = impasto.run(source, tmp_path / "made.zarr", pooling="none", tile=64)
    monkeypatch.setattr("impasto.jobs.rerun", interrupt)
    assert main(["job", "rerun", str(out), "--into", str(out)]) == 130
    assert "nothing was kept" not in capsys.readouterr().err


def test_a_second_store_that_is_interrupted_is_compared_when_it_goes_on(
    source: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, into = tmp_path / "a.zarr", tmp_path / "b.zarr"
    impasto.run(source, out, pooling="none", tile=32)
    rerun = ["job", "rerun", str(out), "--into", str(into), "--quiet"]
    with monkeypatch.context() as patched:
        steps, flush = [], os.fsync

        def full(handle: int) -> None:
            steps.append(handle)
            if len(steps) > 60:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            flush(handle)

        patched.setattr(os, "fsync", full)
        assert main(rerun) == 4
    assert f"go on with: {shlex.join(['impasto', *rerun[:-1]])}" in capsys.readouterr().err
    assert main(rerun) == 0
    assert "the same bytes as" in capsys.readouterr().out


def test_a_lost_scheduler_is_told_in_words_of_the_command_line(
    source: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def lost(*_: object, **__: object) -> None:
        raise impasto.ClusterError(LOST)

    @contextmanager
    def connected(_: str | None) -> Iterator[None]:
        yield None

    monkeypatch.setattr("impasto.jobs.job.fit_tiles", lost)
    monkeypatch.setattr("impasto.jobs.cluster.connected", connected)
    out = tmp_path / "painting.zarr"
    assert main(job(source, out, "--scheduler", "tcp://127.0.0.1:9")) == 4
    said = " ".join(capsys.readouterr().err.split())
    assert "the scheduler is gone; resume the job with a scheduler that runs, or without" in said
    assert said.endswith(f"go on with: impasto job resume {out}"), "without what is gone"


def test_where_terminals_send_no_signal_the_others_are_heard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.delattr(signal, "SIGHUP")
    with pytest.raises(KeyboardInterrupt), terminated_as_interrupted():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) == before


def test_who_ignores_a_closed_terminal_goes_on() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with terminated_as_interrupted():
            signal.raise_signal(signal.SIGHUP)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        with pytest.raises(KeyboardInterrupt), terminated_as_interrupted():
            signal.raise_signal(signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_DFL
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("job run {stack} --out {out}.npz", 1, "--out: expected a name ending in .zarr"),
        ("job run {stack} --out {out}.zarr --memory x", 1, "--memory: expected bytes"),
        ("job run {stack} --out {out}.zarr --memory 8MB", 1, "smaller tiles, which take longer"),
        ("job run {stack} --out {out}.zarr --tile 3", 1, "--tile: expected an even number"),
        ("job run {stack} --out {out}.zarr --pooling segment", 2, 'Choose from: "auto", "none", '),
        ("job run {stack} --out {out}.zarr --region 0 0 9 9", 2, "--region: a job fits the whole"),
        ("job run {stack} --out {out}.zarr --encoding srgb", 1, "--encoding"),
        ("job run nowhere.lp --out {out}.zarr", 1, "nowhere.lp does not exist"),
        ("job status {out}.zarr", 1, "{out}.zarr does not exist"),
        ("job resume {out}.zarr", 1, "{out}.zarr does not exist"),
        ("job verify {out}.zarr", 1, "{out}.zarr does not exist"),
        ("job rerun {out}.zarr --into {out}2.zarr", 1, "{out}.zarr does not exist"),
    ],
)
def test_wrong_uses_are_explained(
    words: str,
    code: int,
    said: str,
    source: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    filled = words.format(stack=source, out=tmp_path / "painting").split()
    assert said.format(out=tmp_path / "painting") in complaint(filled, code, capsys)
    assert list(tmp_path.iterdir()) == []
