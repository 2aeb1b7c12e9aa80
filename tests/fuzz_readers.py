"""A mutation fuzzer for every reader: ``python tests/fuzz_readers.py --cases 100000 exr tiff``.

Small good files, made by the writers themselves, are damaged at random and read. The outcome must
be a result, or an :class:`impasto.ImpastoError`, ``OSError`` or ``MemoryError``, in two seconds and
200 MB. Everything else is a fault: another exception or warning, a crash, a wait. A case
is made of the seed, the reader and its number alone; ``--only NUMBER`` repeats it.

Cases run in a process of their own, so that a crash is a fault like others.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import tifffile

import impasto
from fuzz_captures import LIGHTS, SIZE, captures, optics
from fuzz_mutations import (
    Reader,
    chunks_repaired,
    lines_repaired,
    list_repaired,
    members_changed,
    moved,
    mutated,
    record_repaired,
)
from impasto import io
from impasto.cli.folder import read_report
from impasto.colour.session import read_display
from impasto.io.results.zarr_store import ZarrStore
from impasto.io.session_toml import session_text, sha256_of
from impasto.jobs.journal import read_journal
from impasto.jobs.kept_options import check_options
from impasto.jobs.learning import border_of
from impasto.jobs.photographs import open_photographs
from impasto.jobs.record import JobRecord
from recorded_faults import fuzzed, recorded
from rti_files import rti_readers

SECONDS = 2.0
"""A reader of files of a few kilobytes that takes longer waits for something."""
MEGABYTES = 200
"""64 MiB may be decoded at any ratio; libraries hold a copy or two of it."""
BATCH = 100_000
"""Cases of one process, which first makes the good files for seconds. A crash ends them all."""
FIRST_BATCH = 500
"""Cases from which the pace of a reader is taken."""
PHOTOGRAPHS = "/photographs"
"""Their folder in a record: that of a run has another name each time, and so would its cases."""
WAIT = 1800.0
"""Seconds after which one of its cases waits for ever."""


@dataclass
class Tally:
    """What came of a number of cases, and the processor seconds that they took."""

    outcomes: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.outcomes + other.outcomes,
            self.faults + other.faults,
            self.seconds + other.seconds,
        )


def run(reader: Reader, name: str, seed: int, numbers: Iterator[int], path: Path) -> Tally:
    """Read damaged files; ``path`` is where each lies while it is read."""
    tally = Tally()
    for good in reader.seeds:
        path.write_bytes(good)
        reader.read(path)
    for number in numbers:
        chance = random.Random(f"{seed}/{name}/{number}")
        data = mutated(reader.seeds, chance, text=reader.text)
        path.write_bytes(reader.repair(data, reader.seeds, chance))
        before, began = _peak(), time.process_time()
        outcome = _outcome(reader, path)
        seconds, grown = time.process_time() - began, _peak() - before
        if seconds > SECONDS:
            outcome = f"fault: {seconds:.1f} seconds ({outcome})"
        elif grown > MEGABYTES:
            outcome = f"fault: {grown} MB ({outcome})"
        if outcome.startswith("fault"):
            tally.faults.append(f"{name} --seed {seed} --only {number}: {outcome}")
        tally.outcomes[outcome.split(":")[0]] += 1
    return tally


def _outcome(reader: Reader, path: Path) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", impasto.ImpastoWarning)
            reader.read(path)
    except impasto.InternalError as error:
        return f"fault: {error}"
    except (impasto.ImpastoError, OSError, MemoryError) as error:
        return type(error).__name__
    except Exception as error:
        return f"fault: {type(error).__name__}: {error}"[:300]
    return "read"


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


# --- good files


def readers(folder: Path) -> dict[str, Reader]:
    """All readers by name, with good files that are made in ``folder``."""
    small = {**_pictures(folder), **_texts(folder), **_session(folder)}
    rest = {**_archives(folder), **_jobs(folder), **optics(folder), **captures(folder)}
    return {**small, **rest, **rti_readers(folder)}


def _all(folder: Path, suffix: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.glob(f"*{suffix}"))]


def _pictures(folder: Path) -> dict[str, Reader]:
    codes = np.random.default_rng(1).integers(0, 65536, (*SIZE, 3), dtype=np.uint16)
    planes = {name: np.float32(codes[..., i]) / 65535 for i, name in enumerate("RGB")}
    bands = np.moveaxis(codes, -1, 0)
    io.write_png16(folder / "a.png", codes)
    io.write_png8(folder / "b.png", np.uint8(codes[..., 0] >> 8))
    io.write_jpeg(folder / "a.jpg", np.uint8(codes >> 8))
    io.write_jpeg(folder / "b.jpg", np.uint8(codes[..., 0] >> 8))
    io.write_tiff16(folder / "a.tif", codes)
    io.write_tiff32(folder / "b.tif", np.float32(bands), attributes={"a": 1})
    tifffile.imwrite(folder / "c.tif", codes, tile=(16, 16), photometric="rgb")
    tifffile.imwrite(folder / "d.tif", codes, rowsperstrip=3, predictor=2, compression=8)
    tifffile.imwrite(folder / "e.tif", bands, photometric="minisblack", bigtiff=True)
    cv2.imwrite(str(folder / "f.tif"), codes, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    io.write_exr(folder / "a.exr", planes)
    for name in ("PIZ", "B44", "DWAA", "RLE", "PXR24", "HTJ2K32", "ZIPS"):
        tile = OpenEXR.TileDescription()
        tile.xSize = tile.ySize = 8
        kind = OpenEXR.tiledimage if name in {"PIZ", "RLE"} else OpenEXR.scanlineimage
        header = {"type": kind, "compression": getattr(OpenEXR, f"{name}_COMPRESSION")}
        header |= {"tiles": tile} if kind == OpenEXR.tiledimage else {}
        half = {key: np.float16(plane) for key, plane in planes.items()}
        OpenEXR.File(header, half).write(str(folder / f"{name}.exr"))
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage, "name": name}, {f"{name}.Y": plane})
        for name, plane in planes.items()
    ]
    OpenEXR.File(parts).write(str(folder / "parts.exr"))
    wide = np.full((8, 16, 3), 0.5, np.float32)
    cv2.imwrite(str(folder / "a.hdr"), wide)
    return {
        "png": Reader(".png", _all(folder, ".png"), io.read_image, repair=chunks_repaired),
        "jpeg": Reader(".jpg", _all(folder, ".jpg"), io.read_image),
        "tiff": Reader(".tif", _all(folder, ".tif"), io.read_image),
        "exr": Reader(".exr", _all(folder, ".exr"), _every_layer),
        "hdr": Reader(".hdr", _all(folder, ".hdr"), impasto.Environment.read),
    }


def _every_layer(path: Path) -> None:
    try:
        io.read_image(path)
    except impasto.ArgumentError as error:
        if "layer" not in str(error):
            raise
        io.read_image(path, layer="R")


def _texts(folder: Path) -> dict[str, Reader]:
    rows = [" ".join(map(str, light)) for light in LIGHTS]
    named = "".join(f"{i}.png {row}\n" for i, row in enumerate(rows))
    lists = [list(light) for light in LIGHTS]
    dome = {"directions": lists, "imageWidth": 300, "domeDiameter": 600, "verticalOffset": 1.5}
    ball = {"lightConfiguration": "spherical", "ledAdjust": [{"r": 1, "g": 1, "b": 1}] * 5}
    images = [{"filename": f"{i}.png", "direction": one} for i, one in enumerate(lists)]
    lights = {f"{i}": {"direction": one, "intensity": [1, 1, 1]} for i, one in enumerate(lists)}
    places = {"positions3d": lists, "imageWidth": 3, "lightConfiguration": "lights3d"}

    def read_rows(path: Path) -> None:
        with contextlib.suppress(impasto.ArgumentError):
            io.read_lights(path)
        io.read_lights(path, layout="columns")

    table = "wavelength,red,green,illuminant\n400,0.1,0.5,90\n500,0.4,0.6,100\n600,0.8,0.1,99\n"
    spectra = "nm,one,two\n" + "".join(f"{n},0.{n % 7}1,0.{n % 5}\n" for n in range(400, 720, 20))
    columns = zip(*(row.split(",") for row in spectra.split()), strict=True)
    transposed = "\n".join(" ; ".join(column) for column in columns)
    viewed = named.replace(" ", ",").replace("\n", ",0,0,1\n")
    screen = {
        "white": [55.9, 61.0, 67.3],
        "primaries": [[24.9, 13.7, 1.7], [19.8, 42.4, 8.5], [11.8, 5.5, 57.9]],
        "black": [0.31, 0.33, 0.36],
        "curve": 2.2,
    }

    def reader(suffix: str, read: Any, *texts: Any) -> Reader:
        seeds = [t if isinstance(t, str) else json.dumps(t, indent=1) for t in texts]
        return Reader(suffix, [seed.encode() for seed in seeds], read, text=True)

    return {
        "lp": reader(".lp", io.read_lights, f"5\n{named}", named),
        "txt": reader(".txt", read_rows, "\n".join(rows), f"5\n{rows[0]}\n{rows[1]}\n{rows[2]}"),
        "csv": reader(".csv", io.read_lights, named.replace(" ", ","), viewed,
                      "n;x;y;z\n" + named.replace(" ", ";")),
        "dome": reader(".dome", io.read_lights, dome, dome | ball, places),
        "relight": reader(".relight", io.read_lights, {"images": images, "pixelSize": 0.1},
                          {"images": [{"filename": "a"}] * 5, "dome": dome}),
        "alicevision": reader(".json", io.read_lights, {"lights": lights}),
        "camera": reader(".csv", io.read_camera, table),
        "spectra": reader(".csv", io.read_spectra, spectra, transposed, spectra.replace(",", "\t")),
        "display": reader(".json", read_display, screen),
        "report": reader(".json", _report, {
            "schema": 1, "command": "fit", "versions": {"impasto": "1"}, "notes": [],
            "inputs": [{"file": "a", "sha256": "0", "bytes": 1}], "timings_s": {"a": 1.0},
            "outputs": [], "results": {"shape": [5, 3, 8, 8], "status": {"fitted": 64}},
        }),
    }  # fmt: skip


def _report(path: Path) -> None:
    """A report is known by its name."""
    named = path.with_name("report.json")
    path.rename(named)
    try:
        read_report(named.parent)
    finally:
        named.unlink()


def _session(folder: Path) -> dict[str, Reader]:
    """Session files, of which the photographs are read as they say."""
    home = folder / "session"
    home.mkdir()
    names = [f"{i}.png" for i in range(len(LIGHTS))]
    for i, name in enumerate(names):
        io.write_png8(home / name, np.full(SIZE, 40 * i + 40, np.uint8))
    io.write_lights(home / "a.lp", LIGHTS, names)
    hashes = {name: sha256_of(home / name) for name in names}
    lamps = dict(zip(names, LIGHTS, strict=True))
    seeds = [
        io.Session(lights="a.lp", encoding="2.2", saturation=250.0, mask="4.png", sha256=hashes),
        io.Session(directions=lamps, views=dict.fromkeys(names, (0, 0, 1)), dark=2, white="4.png"),
        io.Session(positions_mm=lamps, pitch_mm=0.1, bands=("grey",), intensities=(1, 2, 3, 4, 5)),
        io.Session(lights="a.lp", pattern="{name}.png", region=(1, 1, 4, 4), images="."),
    ]

    def read(path: Path) -> None:
        """Photographs lie beside a session."""
        (home / "session.toml").write_bytes(path.read_bytes())
        impasto.read_stack(home)

    texts = [session_text(seed).encode() for seed in seeds]
    return {"session": Reader(".toml", texts, read, text=True)}


def _archives(folder: Path) -> dict[str, Reader]:
    samples = np.random.default_rng(2).random((5, 3, *SIZE)).astype(np.float32)
    stack = impasto.Stack(samples, lights=LIGHTS, mask=np.ones(SIZE, bool))
    io.write_stack(folder / "stack.npz", stack)
    impasto.learn_sbrdf(stack, pooling="painting").save(folder / "learned.npz")
    results = []
    for number, options in enumerate(
        ({"pooling": "painting"}, {"pooling": "none"}, {"model": "lafortune"})
    ):
        file = folder / f"result{number}.npz"
        impasto.fit_sbrdf(stack, check=False, **options).save(file)
        results.append(file.read_bytes())

    def part(path: Path) -> None:
        impasto.read_stack(path, region=(2, 2, 4, 4))

    stacks = [(folder / "stack.npz").read_bytes()]
    learned = [(folder / "learned.npz").read_bytes()]
    return {
        "stack": Reader(".npz", stacks, impasto.read_stack, repair=members_changed),
        "region": Reader(".npz", stacks, part, repair=members_changed),
        "result": Reader(".npz", results, impasto.load_sbrdf, repair=members_changed),
        "learned": Reader(".npz", learned, impasto.load_learned, repair=members_changed),
    }


def _record(folder: Path) -> Reader:
    """Records of jobs of files, of which each is read as the job that goes on does."""
    home = folder / "photographs"
    home.mkdir()
    names = [f"{i}.png" for i in range(len(LIGHTS))]
    for i, name in enumerate(names):
        io.write_png8(home / name, np.full((*SIZE, 3), 40 * i + 40, np.uint8))
    io.write_lights(home / "a.lp", LIGHTS, names)
    readings: tuple[dict[str, Any], ...] = (
        {},
        {"encoding": "2.2", "saturation": [250, 251, 252], "mask": home / "4.png"},
        {
            "white": home / "4.png",
            "dark": 2,
            "intensities": [1, 2, 3, 4, 5],
            "bands": ["a", "b", "c"],
        }
        | {"pitch_mm": 0.1, "max_pixels": 1000},
    )
    seeds = []
    for number, reading in enumerate(readings):
        pooling = ("none", "painting", "pixel")[number]
        out = impasto.run(
            home / "a.lp", folder / f"record{number}.zarr", pooling=pooling, reading=reading
        )
        seeds.append(moved((out / "job" / "job.json").read_bytes(), str(home), PHOTOGRAPHS))

    def read(path: Path) -> None:
        record = JobRecord.read(path)
        check_options(record, path)
        border_of(record.fit)
        list(itertools.islice(record.grid, 3))
        record.differences(replace(record, shape=(1, 1, 1, 1)))
        options = json.dumps(record.reading).replace(PHOTOGRAPHS, str(home))
        open_photographs(home / "a.lp", json.loads(options), 0, record.curve)

    return Reader(".json", seeds, read, text=True, repair=record_repaired)


def _jobs(folder: Path) -> dict[str, Reader]:
    """Records and journals of jobs, and the list of arrays of a store."""
    arrays = {"kind": np.array("a"), "status": np.zeros(SIZE, np.uint8), "x": np.ones(3)}
    ZarrStore().write(folder / "a.zarr", arrays)
    samples = np.random.default_rng(2).random((5, 1, *SIZE)).astype(np.float32)
    stack = impasto.Stack(samples, lights=LIGHTS)
    notes = impasto.run(stack, folder / "job.zarr", pooling="painting") / "job"

    def store(path: Path) -> None:
        """A list of arrays is known by its name, and so is the file of an array."""
        listed = folder / "a.zarr" / "zarr.json"
        before = listed.read_bytes()
        try:
            listed.write_bytes(path.read_bytes())
            ZarrStore().read(listed.parent)
        finally:
            listed.write_bytes(before)

    def array(path: Path) -> None:
        listed = folder / "a.zarr" / "x" / "zarr.json"
        before = listed.read_bytes()
        try:
            listed.write_bytes(path.read_bytes())
            ZarrStore().read(listed.parents[1])
        finally:
            listed.write_bytes(before)

    def reader(file: Path, read: Any, **options: Any) -> Reader:
        return Reader(file.suffix, [file.read_bytes()], read, text=True, **options)

    return {
        "record": _record(folder),
        "journal": reader(notes / "journal.jsonl", read_journal, repair=lines_repaired),
        "store": reader(folder / "a.zarr" / "zarr.json", store, repair=list_repaired),
        "array": reader(folder / "a.zarr" / "x" / "zarr.json", array),
    }


# --- by hand


def _work(names: list[str], seed: int, first: int, count: int, progress: Path) -> None:
    """A batch in this process; the last line of stdout says what came of it."""
    with tempfile.TemporaryDirectory() as name, progress.open("wb", buffering=0) as mark:
        folder = Path(name)
        known = readers(folder)
        (folder / "case").mkdir()

        def marked(reader: str) -> Iterator[int]:
            for number in range(first, first + count):
                os.pwrite(mark.fileno(), f"{reader} --only {number:12}".encode(), 0)
                yield number

        found = {}
        for one in names:
            path = folder / "case" / f"a{known[one].suffix}"
            began = time.process_time()
            tally = run(known[one], one, seed, marked(one), path)
            found[one] = (tally.outcomes, tally.faults, time.process_time() - began)
    sys.stdout.write("\n" + json.dumps(found) + "\n")


def main() -> int:
    """Fuzz the readers that are named, or all; 1 if there is a fault."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("readers", nargs="*", help="default: all")
    options.add_argument("--cases", type=int, default=1000, help="of each reader")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--seconds", type=float, help="of a processor, for each reader: as many")
    options.add_argument("--processes", type=int, default=1, help="side by side, of --cases")
    options.add_argument("--only", type=int, help="one case")
    options.add_argument("--record", action="store_true")
    options.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    options.add_argument("--first", type=int, default=0, help="number of the first case")
    chosen = options.parse_args()
    if chosen.work is not None:
        _work(chosen.readers, chosen.seed, chosen.first, chosen.cases, chosen.work)
        return 0
    if chosen.only is not None:
        chosen.first, chosen.cases = chosen.only, 1
    with tempfile.TemporaryDirectory() as name:
        known = readers(Path(name))
    words = " ".join(word for word in sys.argv[1:] if word not in known)
    found = 0
    for one in chosen.readers or known:
        if chosen.seconds is None:
            cases = chosen.cases
            tally = for_cases(
                one,
                seed=chosen.seed,
                first=chosen.first,
                count=cases,
                processes=chosen.processes,
            )
        else:
            cases, tally = _for_seconds(one, chosen.seed, chosen.first, chosen.seconds)
        counts = ", ".join(f"{count} {what}" for what, count in tally.outcomes.most_common())
        print(f"{one}: {cases} cases, {tally.seconds:.0f} s: {counts}", flush=True)  # noqa: T201
        for fault in tally.faults[:20]:
            print(f"  {fault}", flush=True)  # noqa: T201
        read, faults = tally.outcomes["read"], len(tally.faults)
        row = {"reader": one, "cases": cases, "read": read, "refused": cases - read - faults}
        pace = {
            "per second": cases / tally.seconds,
            "hours for a million": tally.seconds / cases / 3.6e-3,
        }
        found += faults
        if chosen.record:
            # At once: what took hours is not lost with what follows.
            rows = [{**row, "faults": faults, **pace}]
            recorded("readers", rows, f"python tests/fuzz_readers.py {words}")
            fuzzed(rows, chosen.seed, chosen.first)
    return int(found > 0)


def for_cases(reader: str, *, seed: int, first: int, count: int, processes: int) -> Tally:
    """So many cases, in batches of which several run side by side; the tally is the same."""
    size = min(BATCH, -(-count // processes))
    last = first + count
    with ThreadPoolExecutor(processes) as pool:
        batches = pool.map(
            lambda at: _batch(reader, seed, at, min(size, last - at)), range(first, last, size)
        )
        return sum(batches, start=Tally())


def _for_seconds(reader: str, seed: int, first: int, most: float) -> tuple[int, Tally]:
    """Cases for so many processor seconds: a few, then as many more as these let expect."""
    done, tally, batch = 0, Tally(), FIRST_BATCH
    while tally.seconds < 0.9 * most and not tally.faults:
        tally += _batch(reader, seed, first + done, batch)
        done += batch
        left = most - tally.seconds
        batch = min(BATCH, max(1, int(left * done / max(tally.seconds, 1e-3))))
    return done, tally


def _batch(reader: str, seed: int, first: int, count: int) -> Tally:
    """A process of its own."""
    with tempfile.NamedTemporaryFile() as progress:
        words = [sys.executable, __file__, reader, "--seed", seed, "--first", first]
        words += ["--cases", count, "--work", progress.name]
        began = time.perf_counter()

        def ended(outcome: str, what: str) -> Tally:
            last = " ".join(Path(progress.name).read_text().split())
            seconds = time.perf_counter() - began
            return Tally(Counter({outcome: 1}), [f"{last}: {what}"], seconds)

        try:
            done = subprocess.run(
                list(map(str, words)),
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
                timeout=WAIT,
            )
        except subprocess.TimeoutExpired:
            return ended("wait", "waits")
        if done.returncode:
            return ended("crash", f"ended with {done.returncode}: {done.stderr[-300:]}")
    ((outcomes, faults, seconds),) = json.loads(done.stdout.splitlines()[-1]).values()
    return Tally(Counter(outcomes), faults, float(seconds))


if __name__ == "__main__":
    raise SystemExit(main())
