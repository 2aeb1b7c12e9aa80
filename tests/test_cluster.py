"""Jobs on the workers of a real Dask cluster: the bytes of a local job, whatever dies."""

from __future__ import annotations

import itertools
import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import distributed
import numpy as np
import pytest
from distributed.comm import CommClosedError

import impasto
from impasto import ArgumentError, _core, jobs
from impasto.cli import main
from impasto.cli.console import Stages
from impasto.io import write_jpeg, write_lights, write_png8, write_stack
from impasto.jobs import cluster as client_side
from impasto.jobs.learning import digest_of
from impasto.jobs.photographs import open_photographs
from impasto.jobs.worker import SharedJob, fit_tile, release
from interrupted_jobs import interrupting
from job_photographs import photographs
from killed_jobs import stack, tree

pytest.importorskip("fcntl", reason="jobs need POSIX")

pytestmark = pytest.mark.slow

NONE: dict[str, Any] = {"pooling": "none", "tile": 32}
"""Nine tiles."""


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two workers, each a process with one thread and a nanny that starts it again."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as made:
        yield made


@pytest.fixture
def client(cluster: Any) -> Iterator[Any]:
    with distributed.Client(cluster, set_as_default=False) as made:
        made.wait_for_workers(2, timeout=60)
        yield made


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stack") / "painting.npz"
    write_stack(path, stack())
    return path


def command(source: Path, out: Path) -> list[str]:
    """The job of ``NONE`` on the command line."""
    return ["job", "run", str(source), "--out", str(out), "--pooling", "none", "--tile", "32"]


@pytest.fixture(scope="module")
def expected(source: Path) -> dict[str, str]:
    """The bytes of a local job."""
    return tree(impasto.run(source, source.parent / "local.zarr", **NONE))


def test_workers_write_the_bytes_of_a_local_job(client: Any, tmp_path: Path) -> None:
    """Photographs in TIFFs with a mask, one lobe for the painting, tiles of another order."""
    path = photographs(tmp_path)
    options: dict[str, Any] = {"tile": 48, "pooling": "painting", "effort": "draft"}
    options["reading"] = {"mask": tmp_path / "mask.png", "saturation": 65520}
    seen: list[tuple[int, int]] = []
    there = impasto.run(
        path,
        tmp_path / "there.zarr",
        client=client,
        progress=lambda done, total: seen.append((done, total)),
        **options,
    )
    assert tree(there) == tree(impasto.run(path, tmp_path / "here.zarr", **options))
    assert seen == [(done, 4) for done in range(5)]
    assert jobs.verify(there) == ()


def photographs_kept() -> int:
    """On a worker: how many sources of photographs are in its memory."""
    import gc

    from impasto.jobs.photographs import Photographs

    return sum(isinstance(there, Photographs) for there in gc.get_objects())


def test_workers_let_go_of_the_photographs_of_a_job_that_has_ended(
    client: Any, source: Path, tmp_path: Path
) -> None:
    during: set[int] = set()

    def look(done: int, total: int) -> None:
        if done == 5:
            during.update(client.run(photographs_kept).values())

    impasto.run(source, tmp_path / "a.zarr", client=client, progress=look, **NONE)
    assert max(during) == 1
    assert set(client.run(photographs_kept).values()) == {0}


def write_files(folder: Path) -> Path:
    """JPEG photographs of 8 bits with a mask, of which the last tile has nothing."""
    taken = stack()
    names = [f"light{index}.jpg" for index in range(len(taken.rig))]
    for name, codes in zip(names, taken.samples, strict=True):
        write_jpeg(
            folder / name, np.ascontiguousarray(np.moveaxis(codes >> 4, 0, -1).astype(np.uint8))
        )
    write_lights(folder / "dirs.lp", taken.rig, names)
    mask = np.full((*taken.shape[2:], 3), 255, np.uint8)
    mask[60:, 60:] = 0
    write_png8(folder / "mask.png", mask)
    return folder / "dirs.lp"


def test_workers_decode_photographs_in_whole_rows(client: Any, tmp_path: Path) -> None:
    """JPEG and PNG have no tiles: what a worker decodes serves the next tiles, too."""
    path = write_files(tmp_path)
    options: dict[str, Any] = NONE | {"reading": {"mask": tmp_path / "mask.png"}}
    there = impasto.run(path, tmp_path / "there.zarr", client=client, **options)
    assert tree(there) == tree(impasto.run(path, tmp_path / "here.zarr", **options))
    status = impasto.load_sbrdf(there).status
    assert (status[60:, 60:] == impasto.Status.MASKED).all()
    assert (status[:60] < 16).mean() > 0.9


def test_a_worker_that_is_killed_changes_no_byte(
    client: Any, source: Path, expected: dict[str, str], tmp_path: Path
) -> None:
    """Nor does what it left half written."""
    processes = client.run(os.getpid)
    killed: list[int] = []
    left = tmp_path / "a.zarr.partial" / "normal" / "c" / "0" / "0" / ".0-12ab.tmp"

    def kill(done: int, total: int) -> None:
        if done == 1:
            killed.append(next(iter(processes.values())))
            os.kill(killed[0], signal.SIGKILL)
        if done == total:
            left.write_bytes(b"half")

    out = impasto.run(source, tmp_path / "a.zarr", client=client, progress=kill, **NONE)
    assert tree(out) == expected
    assert jobs.verify(out) == ()
    client.wait_for_workers(2, timeout=60)
    assert killed[0] not in client.run(os.getpid).values()


def test_a_job_goes_on_with_a_client_or_without(
    client: Any, source: Path, expected: dict[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "a.zarr"
    for until, by in ((2, client), (5, None)):
        with interrupting(until + 1) as stop:
            impasto.run(source, out, client=by, progress=stop, **NONE)
        # A tile that is on its way to the disk is finished.
        assert jobs.status(out).tiles_done == until + (by is None)
    jobs.resume(out, client=client)
    assert tree(out) == expected


def test_the_command_line_joins_a_running_scheduler(
    cluster: Any,
    source: Path,
    expected: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "a.zarr"
    words = command(source, out)
    assert main([*words, "--scheduler", cluster.scheduler_address, "--quiet"]) == 0
    assert tree(out) == expected
    monkeypatch.setattr(client_side, "PATIENCE", 0.5)
    missing = str(tmp_path / "none.json")
    for scheduler in ("tcp://127.0.0.1:9", missing, "xyz://"):
        words[4] = str(tmp_path / "b.zarr")
        assert main([*words, "--scheduler", scheduler, "--quiet"]) == 1
        said = f"no Dask scheduler answers at {scheduler}"
        said = f"{missing} does not exist" if scheduler == missing else said
        assert said in " ".join(capsys.readouterr().err.split())


def test_a_scheduler_without_workers_is_told(
    source: Path,
    expected: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "a.zarr"
    words = command(source, out)
    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty:
        say = Stages.say

        def add_worker(stages: Stages, text: str) -> None:
            say(stages, text)
            if "no workers" in text:
                empty.scale(1)

        monkeypatch.setattr(Stages, "say", add_worker)
        assert main([*words, "--scheduler", empty.scheduler_address]) == 0
    assert "the scheduler has no workers yet: tiles wait" in capsys.readouterr().err
    assert tree(out) == expected


def full() -> None:
    """On a worker: every flush from now on finds a full disk."""
    import errno

    def fsync(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    os.kept = os.fsync  # type: ignore[attr-defined]
    os.fsync = fsync


def empty() -> None:
    os.fsync = os.kept  # type: ignore[attr-defined]


def test_errors_of_workers_end_a_job_that_can_be_resumed(
    client: Any, source: Path, expected: dict[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "a.zarr"
    client.run(full)
    try:
        with pytest.raises(OSError, match="No space left") as error:
            impasto.run(source, out, client=client, **NONE)
    finally:
        client.run(empty)
    assert ".partial" in str(error.value.filename)
    assert not out.exists()
    assert tree(impasto.run(source, out, client=client, **NONE)) == expected


def test_a_written_tile_is_in_the_journal_before_the_scheduler_is_asked(
    client: Any, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scheduler is lost when the first tile is done."""
    out = tmp_path / "a.zarr"
    calls = itertools.count(1)

    def tiles(_: Any) -> int:
        if next(calls) > client_side.FEWEST:
            raise CommClosedError("gone")
        return client_side.FEWEST

    monkeypatch.setattr(client_side._HandedOut, "tiles", tiles)
    with pytest.raises(impasto.ClusterError, match="the scheduler is gone; resume"):
        impasto.run(source, out, client=client, **NONE)
    assert jobs.status(out).tiles_done == 1


def test_a_worker_makes_smaller_scales_on_one_thread(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Others of its threads are at the next tile."""
    out = tmp_path / "a.zarr"
    with interrupting(2) as stop:
        impasto.run(source, out, progress=stop, **NONE)
    notes = (partial := tmp_path / "a.zarr.partial") / "job"
    job = SharedJob(partial, *(digest_of(notes / name) for name in ("job.json", "learned.npz")), 1)
    reduced, taken = _core.reduced_surface, set()

    def counted(*given: Any) -> Any:
        taken.add(given[-1])
        return reduced(*given)

    worker = SimpleNamespace(address="here", state=SimpleNamespace(nthreads=2))
    monkeypatch.setenv("IMPASTO_NUM_THREADS", "3")
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    monkeypatch.setattr(_core, "reduced_surface", counted)
    try:
        fit_tile(job, (1, 1), False)
    finally:
        release(job)
    assert taken == {1}


@pytest.mark.parametrize("when", ["before", "while"])
def test_a_tile_of_a_job_that_has_ended_opens_no_photographs(
    when: str, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cancelled tile comes to its turn before or while the job is released."""
    out = tmp_path / "a.zarr"
    with interrupting(2) as stop:
        impasto.run(source, out, progress=stop, **NONE)
    notes = (partial := tmp_path / "a.zarr.partial") / "job"
    digests = (digest_of(notes / name) for name in ("job.json", "learned.npz"))
    job = SharedJob(partial, *digests, 1, run=when)
    worker = SimpleNamespace(address=when, state=SimpleNamespace(nthreads=1))
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    before = photographs_kept()

    def opened(*given: Any) -> Any:
        release(job)
        return open_photographs(*given)

    if when == "before":
        release(job)
    else:
        monkeypatch.setattr("impasto.jobs.worker.open_photographs", opened)
    with pytest.raises(impasto.ClusterError, match=r"a\.zarr\.partial has ended"):
        fit_tile(job, (1, 1), False)
    assert photographs_kept() == before
    # The same job goes on with the same workers.
    monkeypatch.undo()
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    again = replace(job, run="again")
    try:
        assert fit_tile(again, (1, 1), False).entry.shards
    finally:
        release(again)
    assert photographs_kept() == before


def dying() -> None:
    """On a worker: every fit ends it."""
    import impasto.jobs.worker

    impasto.jobs.worker.fitted = lambda *given: os._exit(1)


def test_a_tile_that_ends_its_workers_is_named(
    cluster: Any, client: Any, source: Path, tmp_path: Path
) -> None:
    out = tmp_path / "a.zarr"
    allowed = cluster.scheduler.allowed_failures
    cluster.scheduler.allowed_failures = 0
    client.run(dying, workers=[next(iter(client.nthreads()))])
    try:
        with pytest.raises(impasto.ClusterError, match=r"tile \(\d, \d\) was given to 1 workers"):
            impasto.run(source, out, client=client, **NONE)
    finally:
        cluster.scheduler.allowed_failures = allowed
    assert jobs.status(out).state == "interrupted"


def test_a_worker_that_sees_other_photographs_says_so(client: Any, tmp_path: Path) -> None:
    path = photographs(tmp_path)
    other = tmp_path / "light2.tif"

    def shorten(done: int, total: int) -> None:
        other.write_bytes(other.read_bytes()[:-1])

    size = other.stat().st_size
    words = rf"light2\.tif has {size - 1} bytes on the worker \d+ on .*expects {size} bytes"
    with pytest.raises(ArgumentError, match=words):
        impasto.run(path, tmp_path / "a.zarr", client=client, progress=shorten, **NONE)


def test_a_damaged_photograph_is_named_by_the_worker_s_error(client: Any) -> None:
    """Errors that have arguments of their own cross processes, too."""

    def damaged() -> None:
        raise impasto.CorruptInputError(Path("light2.tif"), "is truncated")

    with pytest.raises(impasto.CorruptInputError, match=r"^light2\.tif: is truncated$"):
        client.submit(damaged).result()


def test_what_cannot_run_on_a_cluster_is_refused_at_once(
    client: Any, source: Path, tmp_path: Path
) -> None:
    out = tmp_path / "a.zarr"
    with pytest.raises(ArgumentError, match=r"client: expected a dask\.distributed\.Client"):
        impasto.run(source, out, client="tcp://127.0.0.1:8786", **NONE)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match=r"source: the workers .*write_stack"):
        impasto.run(stack(), out, client=client, **NONE)
    client.close()
    with pytest.raises(ArgumentError, match="client: is closed"):
        impasto.run(source, out, client=client, **NONE)
    assert list(tmp_path.iterdir()) == []
