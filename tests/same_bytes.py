"""One hash of all maps: instruction sets x threads x tiles x numpy, dask and the command line.

``python tests/same_bytes.py`` prints a line for every way and says how many hashes there are. The
instruction set is chosen when impasto is loaded, so that each has a process of its own, whose
workers and commands take it over.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import impasto
from impasto import _core
from impasto.io import write_stack
from killed_jobs import stack
from processes import run, surroundings

SIZE = (150, 170)
"""Nine tiles of 64, four of 100, one of 256 or more pixels; jobs cut their one to 192 pixels."""
THREADS, TILES = (1, 2, 3, 5, 8), (64, 100, 256, 1024)
SETS = ("baseline", "avx2", "avx512")
"""Those that the processor does not have are left out."""
OPTIONS: dict[str, Any] = {"pooling": "pixel", "lobes": 2}
"""Lobes per pixel, whose searches start from neighbours: tiles need a border."""


def digest(maps: dict[str, np.ndarray]) -> str:
    """SHA-256 of maps by name."""
    found = hashlib.sha256()
    for name, array in sorted(maps.items()):
        found.update(f"{name} {array.dtype.str} {array.shape}".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def maps_of(dataset: Any) -> dict[str, np.ndarray]:
    """The maps ``(..., y, x)`` of a dataset."""
    return {
        str(name): one.values
        for name, one in dataset.data_vars.items()
        if one.dims[-2:] == ("y", "x")
    }


def by_numpy(threads: int, tile: int) -> dict[str, np.ndarray]:
    """Tile after tile, put together."""
    taken = stack(SIZE)
    model = impasto.learn_sbrdf(taken, threads=threads, **OPTIONS)
    assert model.halo, "the fit needs no border, which is what tiles are most likely to get wrong"
    whole: dict[str, np.ndarray] = {}
    for top in range(0, SIZE[0], tile):
        for left in range(0, SIZE[1], tile):
            part = slice(top, top + tile), slice(left, left + tile)
            maps = maps_of(model.apply(taken, *part, threads=threads).to_xarray())
            for name, array in maps.items():
                if name not in whole:
                    whole[name] = np.empty((*array.shape[:-2], *SIZE), array.dtype)
                whole[name][..., *part] = array
    return whole


def lazily(tile: int) -> Any:
    import dask.array

    taken = stack(SIZE)
    samples = dask.array.from_array(taken.samples, chunks=(-1, -1, tile, tile))
    about = {"scale": taken.scale, "saturation": taken.saturation}
    return impasto.fit_sbrdf(impasto.LazyStack(samples, lights=taken.rig, **about), **OPTIONS)


def of_store(path: Path) -> dict[str, np.ndarray]:
    return maps_of(impasto.load_sbrdf(path).to_xarray())


def by_command_line(source: Path, out: Path, threads: int, tile: int) -> dict[str, np.ndarray]:
    words = ["job", "run", str(source), "--out", str(out), "--quiet"]
    words += ["--pooling", "pixel", "--lobes", "2", "--tile", str(tile), "--threads", str(threads)]
    subprocess.run([sys.executable, "-m", "impasto", *words], env=surroundings(), check=True)
    return of_store(out)


def ways(folder: Path, client: Any, threads: int, tile: int) -> Iterator[tuple[str, Any]]:
    """Every way to fit the painting, by name; ``client`` has workers of so many threads."""
    source, name = folder / "painting.npz", f"{threads}-{tile}"

    def on_cluster() -> dict[str, np.ndarray]:
        out = folder / f"cluster-{name}.zarr"
        return of_store(impasto.run(source, out, client=client, tile=tile, **OPTIONS))

    yield "numpy", lambda: by_numpy(threads, tile)
    yield (
        "dask threads",
        lambda: maps_of(lazily(tile).compute(scheduler="threads", num_workers=threads)),
    )
    yield "distributed, lazy", lambda: maps_of(lazily(tile).compute(scheduler=client))
    yield "distributed, job", on_cluster
    yield (
        "command line",
        lambda: by_command_line(source, folder / f"line-{name}.zarr", threads, tile),
    )


def hashes(threads: list[int], tiles: list[int]) -> Iterator[str]:
    """A hash for every way in this process, printed as soon as it is known."""
    from distributed import Client, LocalCluster

    simd = _core.build_info()["simd"]
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        write_stack(folder / "painting.npz", stack(SIZE))
        for count in threads:
            workers = {"n_workers": 2, "threads_per_worker": count}
            with (
                LocalCluster(**workers, processes=True, dashboard_address=None) as cluster,
                Client(cluster, set_as_default=False) as client,
            ):
                for tile in tiles:
                    for name, fit in ways(folder, client, count, tile):
                        start = time.monotonic()
                        found = digest(fit())
                        seconds = time.monotonic() - start
                        sys.stdout.write(
                            f"{simd}, {count} threads, tile {tile:4d}, {name:17}  {found}  "
                            f"{seconds:.1f} s\n"
                        )
                        sys.stdout.flush()
                        yield found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, nargs="+", default=THREADS)
    parser.add_argument("--tiles", type=int, nargs="+", default=TILES)
    parser.add_argument("--sets", nargs="+", default=SETS, choices=SETS)
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.here:
        return len(list(hashes(given.threads, given.tiles))) == 0
    found: list[str] = []
    for simd in given.sets:
        used = run(
            "from impasto import _core; print(_core.build_info()['simd'])", IMPASTO_SIMD=simd
        )
        if used.strip() != simd:
            sys.stdout.write(f"{simd}: this processor has {used.strip()} instead\n")
            continue
        words = ["--here", "--threads", *map(str, given.threads), "--tiles", *map(str, given.tiles)]
        with subprocess.Popen(
            [sys.executable, __file__, *words],
            env=surroundings(IMPASTO_SIMD=simd),
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                sys.stdout.write(line)
                sys.stdout.flush()
                found.append(line.split()[-3])
        if process.returncode > 0:
            return process.returncode
    sys.stdout.write(f"{len(found)} ways, {len(set(found))} hash: {' '.join(sorted(set(found)))}\n")
    return int(len(set(found)) != 1)


if __name__ == "__main__":
    sys.exit(main())
