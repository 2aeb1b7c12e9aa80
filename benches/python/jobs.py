"""Jobs of any size: memory, pace, and what a job costs beside the fit in memory.

    python benches/python/jobs.py [--scale 67 268 1074 [--half]] [--overhead 4] [--sample 1500]
                                  [--ingest 16] [--files 67 [--half] [--folder FOLDER]] [--record]

``--scale``: megapixels of virtual paintings under 16 lights in six bands of 16 bits: windows of
them are made of one piece of noise, so that no photographs lie on the disk. Photometric stereo by
least squares, tiles of 1024, a budget of 1 GiB, one process for each size; ``peak`` is the largest
resident memory of the process, ``over`` what it exceeds the budget by. The store takes about 74
bytes per pixel of the disk, with ``--half`` (half precision) 48.

``--overhead``: megapixels of a painting in 16 tiled TIFFs of three bands of 16 bits, read and
fitted whole, and by a job with tiles of 1024, in processes of their own, one after the other:
processor and wall-clock seconds of the call, the least of two where the fit takes less than ten
seconds.

``--ingest``: megapixels of the same photographs, put into one store by ``impasto.ingest``: MB/s of
what is written, and of as many random bytes that are written into one file and flushed, in turn;
the best of five rounds each, and the median of their ratios; processor seconds per GB.

``--files``: megapixels of a painting in 16 tiled TIFFs of six bands of 16 bits, which are written
to the disk (192 bytes per pixel, and the store as above; ``--folder`` says where, all is removed
afterwards) and fitted by a job with a budget of 1 GiB, in a process of its own. ``fit`` is the
processor time per megapixel of ``LearnedModel.apply`` on four megapixels in memory, ``reading``
that of reading these; ``hashes, learning`` and ``tiles`` are the two parts of the job, ``share``
what of the tiles' time the fit is. ``disk MB/s`` are what the disk itself reads and writes with
nothing else to do, in pieces of 16 MiB, past the cache; ``of the disk`` is the time that it
would take for what the job moved (by ``/proc/self/io``), over the time of the job.

``--sample``: rows and columns of a simulated painting, satin, 24 lamps, three bands of 8 bits;
learned from its systematic sample and from all pixels, applied to all: processor seconds of both
steps, mean error of normals in degrees, and the painting's lobe.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from record import run_info, show, write
from rigs import dome

import impasto
from impasto import simulate
from impasto._internal.windows import within
from impasto.encoding import Encoding
from impasto.io import read_header, write_lights
from impasto.io.results.precision import Precision, checked_precision
from impasto.jobs import Footprint, Photographs

RECORD = Path(__file__).parents[1] / "results" / "jobs.json"
BUDGET = 1 << 30
LIGHTS, BANDS = 16, 6
PIECE = 512
STEREO: dict[str, Any] = {"pooling": "none", "normals": "least-squares"}
FITS: dict[str, dict[str, Any]] = {
    "stereo, robust": {"pooling": "none"},
    "one lobe, draft": {"pooling": "painting", "effort": "draft"},
    "one lobe": {"pooling": "painting"},
    "default": {},
    "own lobes": {"pooling": "pixel"},
}
CHEAP: dict[str, dict[str, Any]] = {
    "stereo": STEREO,
    "one lobe, apart": {"pooling": "painting", "joint": False},
}
ROUNDS, LONG = 2, 10.0


def piece(bands: int, side: int) -> impasto.Stack:
    """A matte surface with waves, in shot noise."""
    rng = np.random.default_rng(7)
    # Slopes are not steepest where pieces, and so tiles, meet: the doctor would find seams there.
    y, x = np.mgrid[:side, :side] * (2.0 * np.pi / side) + 0.3
    normal = np.stack([0.2 * np.sin(5 * x), 0.2 * np.cos(3 * y + x), np.ones((side, side))])
    normal /= np.linalg.norm(normal, axis=0)
    lights = dome(LIGHTS)
    albedo = rng.uniform(0.2, 0.7, (bands, 1, 1)) * (1.0 + 0.3 * np.sin(7 * x + 2 * y))
    light = albedo * np.maximum(np.tensordot(lights, normal, 1), 0.0)[:, None]
    codes = rng.normal(4e4 * light, np.sqrt(20.0 * 4e4 * light))
    samples = np.clip(np.rint(codes), 0, 65535).astype(np.uint16)
    return impasto.Stack(samples, lights=lights, scale=1 / 4e4, saturation=65535)


class Virtual(Photographs):
    """A painting of any size, whose every piece is the same."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._piece = piece(BANDS, PIECE)
        self._size = size

    @property
    def shape(self) -> tuple[int, int, int, int]:
        return LIGHTS, BANDS, *self._size

    @property
    def pixel(self) -> Footprint:
        return Footprint(2 * LIGHTS * BANDS, 0, LIGHTS, BANDS)

    @property
    def source_grid(self) -> tuple[int, int]:
        return 1, 1

    @property
    def encoding(self) -> Encoding:
        return Encoding("linear")

    @property
    def notes(self) -> list[list[str]]:
        return []

    def inputs(self) -> list[dict[str, Any]]:
        return [{"file": "a virtual painting", "sha256": ""}]

    def window(self, rows: slice, columns: slice) -> impasto.Stack:
        height, width = self._size
        size = rows.stop - rows.start, columns.stop - columns.start
        samples = np.empty((LIGHTS, BANDS, *size), np.uint16)
        # Part by part: a second copy of a window would be memory that no reader of files needs.
        for row, column in np.ndindex(-(-height // PIECE), -(-width // PIECE)):
            top, left = row * PIECE, column * PIECE
            down = slice(max(rows.start, top), min(rows.stop, top + PIECE))
            across = slice(max(columns.start, left), min(columns.stop, left + PIECE))
            if down.start < down.stop and across.start < across.stop:
                into = within((down, across), (rows, columns))
                part = within((down, across), (slice(top, None), slice(left, None)))
                samples[..., *into] = self._piece.samples[..., *part]
        right = (columns.start + columns.stop - width) / 2
        up = (height - rows.start - rows.stop) / 2
        return self._piece._replace(samples=samples, rig=self._piece.rig.part(right, up))


def scaled(megapixels: float, precision: Precision, folder: Path) -> dict[str, Any]:
    """One job in this process."""
    side = round(math.sqrt(megapixels * 1e6) / 1024) * 1024 or 1024
    out = folder / "virtual.zarr"
    start, used = time.perf_counter(), time.process_time()
    impasto.run(Virtual((side, side)), out, memory=BUDGET, tile=1024, precision=precision, **STEREO)
    wall, processor = time.perf_counter() - start, time.process_time() - used
    written = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "megapixels": side**2 / 1e6,
        "peak MiB": peak,
        "over MiB": peak - BUDGET / 2**20,
        "seconds": wall,
        "Mpx/s": side**2 / 1e6 / wall,
        "Mpx/s and core": side**2 / 1e6 / processor,
        "written MB/s": written / 1e6 / wall,
        "GB": written / 1e9,
    }


def overhead(way: str, fit: str, folder: Path) -> dict[str, Any]:
    """The fit in memory, or the job, in this process."""
    start, used = time.perf_counter(), time.process_time()
    if way == "memory":
        impasto.fit_sbrdf(impasto.read_stack(folder / "dirs.lp"), **FITS[fit])
    else:
        out = folder / "job.zarr"
        shutil.rmtree(out, ignore_errors=True)
        impasto.run(folder / "dirs.lp", out, tile=1024, **FITS[fit])
    return {"seconds": time.perf_counter() - start, "processor": time.process_time() - used}


def disk_speeds(folder: Path) -> dict[str, float]:
    """Bytes per second that the disk reads and writes, of a gigabyte of random bytes."""
    block, path = np.random.default_rng(1).bytes(1 << 24), folder / "plain"
    start = time.perf_counter()
    with path.open("wb") as file:
        for _ in range(64):
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
        written = time.perf_counter()
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    begun = time.perf_counter()
    with path.open("rb", buffering=0) as file:
        while file.read(len(block)):
            pass
    read = time.perf_counter()
    path.unlink()
    return {"read": 64 * len(block) / (read - begun), "write": 64 * len(block) / (written - start)}


def moved() -> dict[str, int]:
    """Bytes that this process has had from the disk and given to it."""
    lines = Path("/proc/self/io").read_text(encoding="ascii").splitlines()
    found = {name: int(count) for name, count in (line.split(": ") for line in lines)}
    return {"read": found["read_bytes"], "write": found["write_bytes"]}


def file_job(fit: str, precision: Precision, folder: Path) -> dict[str, Any]:
    """A job on files in this process."""
    out, marks = folder / "job.zarr", [0.0]
    side = read_header(folder / "light00.tif").width
    tiles = math.ceil(side / 1024) ** 2

    def seen(done: int, total: int) -> None:
        if (done, total) == (0, tiles):
            marks[0] = time.process_time()

    start, used = time.perf_counter(), time.process_time()
    impasto.run(
        folder / "dirs.lp", out, memory=BUDGET, tile=1024, precision=precision, progress=seen,
        **CHEAP[fit],
    )  # fmt: skip
    megapixels = side**2 / 1e6
    return {
        "megapixels": megapixels,
        "peak MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "seconds": time.perf_counter() - start,
        "hashes, learning": (marks[0] - used) / megapixels,
        "tiles": (time.process_time() - marks[0]) / megapixels,
        **moved(),
    }


def file_fit(fit: str, folder: Path) -> dict[str, Any]:
    """Processor seconds per megapixel of reading and fitting a part in memory, in this process."""
    start = time.process_time()
    side = min(2048, read_header(folder / "light00.tif").width)
    stack = impasto.read_stack(folder / "dirs.lp", region=(0, 0, side, side))
    read = time.process_time()
    model = impasto.learn_sbrdf(stack, **CHEAP[fit])
    found = []
    for _ in range(ROUNDS):
        learned = time.process_time()
        model.apply(stack)
        found.append(time.process_time() - learned)
    megapixels = side**2 / 1e6
    return {"reading": (read - start) / megapixels, "fit": min(found) / megapixels}


def filed(megapixels: float, precision: Precision, folder: Path) -> list[dict[str, Any]]:
    """Jobs on files of six bands against the same fits in memory, and against the disk."""
    photographs(megapixels, folder, BANDS)
    rows = []
    for fit in CHEAP:
        disk = disk_speeds(folder)
        memory = in_own_process("file-fit", fit, str(folder))
        job = in_own_process("file-job", fit, precision, str(folder))
        shutil.rmtree(folder / "job.zarr")
        busy = sum(job[way] / disk[way] for way in ("read", "write"))
        rows.append(
            {
                "fit": fit,
                "Mpx": job["megapixels"],
                "peak MiB": job["peak MiB"],
                "seconds": job["seconds"],
                "Mpx/s": job["megapixels"] / job["seconds"],
                "fit s/Mpx": memory["fit"],
                "reading s/Mpx": memory["reading"],
                "hashes, learning s/Mpx": job["hashes, learning"],
                "tiles s/Mpx": job["tiles"],
                "share": memory["fit"] / job["tiles"],
                "disk reads MB/s": disk["read"] / 1e6,
                "disk writes MB/s": disk["write"] / 1e6,
                "read GB": job["read"] / 1e9,
                "written GB": job["write"] / 1e9,
                "of the disk": busy / job["seconds"],
            }
        )
    return rows


def ingested(megapixels: float, folder: Path) -> list[dict[str, Any]]:
    """The store of all photographs against the disk."""
    photographs(megapixels, folder)
    size = sum((folder / f"light{index:02}.tif").stat().st_size for index in range(LIGHTS))
    block = np.random.default_rng(1).bytes(1 << 24)
    times: dict[str, list[float]] = {"ingest": [], "disk": [], "processor": []}
    for _ in range(5):
        start = time.perf_counter()
        with (folder / "plain").open("wb") as file:
            for _ in range(size // len(block)):
                file.write(block)
            file.flush()
            os.fsync(file.fileno())
        times["disk"].append(time.perf_counter() - start)
        (folder / "plain").unlink()
        start, used = time.perf_counter(), time.process_time()
        impasto.ingest(folder / "dirs.lp", folder / "stack.zarr", memory=BUDGET)
        times["ingest"].append(time.perf_counter() - start)
        times["processor"].append(time.process_time() - used)
        shutil.rmtree(folder / "stack.zarr")
    speeds = {f"{name} MB/s": size / 1e6 / min(times[name]) for name in ("ingest", "disk")}
    ratios = [one / two for one, two in zip(times["disk"], times["ingest"], strict=True)]
    return [
        {
            "GB": size / 1e9,
            **speeds,
            "share of the disk": speeds["ingest MB/s"] / speeds["disk MB/s"],
            "median share": statistics.median(ratios),
            "processor s/GB": min(times["processor"]) / (size / 1e9),
        }
    ]


def from_sample(side: int, sample: int | None) -> dict[str, Any]:
    """What is learned from some pixels, in this process."""
    painting = simulate.painting(0, (side, side), varnish="satin", pitch_mm=102.4 / side)
    lights = [impasto.DistantLight((*one,), 0.5) for one in dome(24).tolist()]
    rig = impasto.Rig(lights, pitch_mm=painting.pitch_mm)
    taken = simulate.capture(painting, rig, "rgb", encoding="srgb", bits=8, exposure=0.5).stack
    start = time.process_time()
    model = impasto.learn_sbrdf(taken, sample=sample)
    learned = time.process_time()
    found = model.apply(taken)
    applied = time.process_time()
    cosine = np.sum(found.normal * painting.surface().normal, axis=0)
    return {
        "sample": str(sample or "default"),
        "learn s": learned - start,
        "apply s": applied - learned,
        "error deg": float(np.degrees(np.nanmean(np.arccos(np.clip(cosine, -1.0, 1.0))))),
        "beta": found.gloss.beta,
        "gamma rad": found.gloss.gamma,
    }


def in_own_process(*words: str) -> dict[str, Any]:
    command = [sys.executable, str(Path(__file__)), "--call", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def photographs(megapixels: float, folder: Path, bands: int = 3) -> None:
    """Tiled TIFFs and their lights: in every tile the same piece, so that none is held whole."""
    across = round(math.sqrt(megapixels * 1e6) / PIECE)
    small = piece(bands, PIECE)
    names = [f"light{index:02}.tif" for index in range(LIGHTS)]
    for name, codes in zip(names, small.samples, strict=True):
        tifffile.imwrite(
            folder / name,
            itertools.repeat(np.ascontiguousarray(np.moveaxis(codes, 0, -1)), across**2),
            shape=(across * PIECE, across * PIECE, bands),
            dtype=codes.dtype,
            tile=(PIECE, PIECE),
            photometric="rgb" if bands == 3 else "minisblack",
            planarconfig="contig",
        )
    write_lights(folder / "dirs.lp", small.rig, names)


def compared(megapixels: float, folder: Path) -> list[dict[str, Any]]:
    photographs(megapixels, folder)
    rows = []
    for fit in FITS:
        best: dict[str, dict[str, float]] = {}
        for _ in range(ROUNDS):
            for way in ("memory", "job"):
                found = in_own_process("overhead", way, fit, str(folder))
                before = best.get(way, found)
                best[way] = {name: min(before[name], found[name]) for name in found}
            if best["memory"]["processor"] > LONG:
                break
        row: dict[str, Any] = {"fit": fit}
        for name in ("processor", "seconds"):
            row |= {f"{name}, memory": best["memory"][name], f"{name}, job": best["job"][name]}
            row[f"{name}, ratio"] = best["job"][name] / best["memory"][name]
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scale", type=float, nargs="*", default=[])
    parser.add_argument("--half", action="store_true")
    parser.add_argument("--overhead", type=float)
    parser.add_argument("--ingest", type=float)
    parser.add_argument("--files", type=float)
    parser.add_argument("--sample", type=int)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--call", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.call:
        what, *words, folder = options.call
        if what == "scale":
            print(json.dumps(scaled(float(words[0]), checked_precision(words[1]), Path(folder))))
        elif what == "file-job":
            print(json.dumps(file_job(words[0], checked_precision(words[1]), Path(folder))))
        elif what == "file-fit":
            print(json.dumps(file_fit(words[0], Path(folder))))
        else:
            print(json.dumps(overhead(*words, Path(folder))))
        return
    tables: dict[str, Any] = {}
    precision: Precision = "half" if options.half else "single"
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        for megapixels in options.scale:
            row = in_own_process("scale", str(megapixels), precision, name)
            tables.setdefault("scale", []).append(row)
            shutil.rmtree(Path(name) / "virtual.zarr")
        if options.overhead:
            tables["overhead"] = compared(options.overhead, Path(name))
        if options.ingest:
            tables["ingest"] = ingested(options.ingest, Path(name))
        if options.files:
            tables["files"] = filed(options.files, precision, Path(name))
    if options.sample:
        tables["sample"] = [from_sample(options.sample, sample) for sample in (None, 1)]
    for title, rows in tables.items():
        show(title, rows)
    if options.record:
        words = " ".join(sys.argv[1:]).replace(f" --folder {options.folder}", "")
        run = run_info(f"benches/python/jobs.py {words}")
        # Tables that were not measured anew stay, each with the run that it is from.
        before = json.loads(RECORD.read_text(encoding="utf-8"))
        runs = {
            title: before["runs"].get(title) for title in before if title not in {"run", "runs"}
        }
        write(
            RECORD.name, before | tables | {"run": run, "runs": runs | dict.fromkeys(tables, run)}
        )


if __name__ == "__main__":
    main()
