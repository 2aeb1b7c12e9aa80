"""Ratios of times, printed at the end of a run and recorded by ``--record``.

    pytest benches/python [--record]

Every round times each peer once and then ours: what else the machine does falls on all of them.
Times are processor times, those of the system included, but for the wall clock where threads are
compared. ``--record`` writes ``benches/results/NAME.json`` for every
``test_NAME_bench.py``. numpy's own threads are one, whoever runs this.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from statistics import median
from typing import Any

import pytest

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# A plugin of pytest may have loaded numpy before this file could say anything.
if "numpy" in sys.modules and any(os.environ.get(variable) != "1" for variable in THREADS):
    raise pytest.UsageError(f"numpy is loaded already: set {', '.join(THREADS)} to 1 beforehand")
os.environ.update(dict.fromkeys(THREADS, "1"))

# numpy reads the variables when it loads.
from record import run_info, show, write  # noqa: E402

ROWS = pytest.StashKey[dict[str, list[dict[str, Any]]]]()
ROUNDS = 9
SEED = 0


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record", action="store_true", help="write benches/results/*.json")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ROWS] = {}


@pytest.fixture
def versus(benchmark: Any, request: pytest.FixtureRequest) -> Callable[..., Any]:
    """Time a call and its peers in turns: ``versus(ours, {name: peer})`` returns ours' result.

    ``goal`` maps a peer's name to the ratio that is asked for; ``megapixels`` are what one call of
    ours goes through.
    """

    def run(
        ours: Callable[[], Any],
        peers: Mapping[str, Callable[[], Any]],
        *,
        goal: Mapping[str, float] | None = None,
        megapixels: float | None = None,
        rounds: int = ROUNDS,
        clock: Callable[[], float] = time.process_time,
    ) -> Any:
        times: dict[str, list[float]] = {"": [], **{name: [] for name in peers}}

        def timed(name: str, call: Callable[[], Any]) -> Any:
            start = clock()
            found = call()
            times[name].append(clock() - start)
            return found

        def others() -> None:
            for name, peer in peers.items():
                timed(name, peer)

        for call in (*peers.values(), ours):
            call()
        found = benchmark.pedantic(lambda: timed("", ours), setup=others, rounds=rounds)
        mine = times.pop("")
        for name, theirs in times.items():
            ratio = median(b / a for a, b in zip(mine, theirs, strict=True))
            row: dict[str, Any] = {
                "ours": request.node.name.removeprefix("test_"),
                "peer": name,
                "ours ms": _short(1e3 * min(mine)),
                "median": _short(1e3 * median(mine)),
                "peer ms": _short(1e3 * min(theirs)),
                "its median": _short(1e3 * median(theirs)),
                "ratio of minima": _short(min(theirs) / min(mine)),
                "median ratio": _short(ratio),
                "asked for": (goal or {}).get(name, "-"),
                "Mpx/s": "-" if megapixels is None else _short(megapixels / min(mine)),
            }
            module = request.node.path.stem.removeprefix("test_").removesuffix("_bench")
            request.config.stash[ROWS].setdefault(module, []).append(row)
        return found

    return run


def _short(number: float) -> float:
    return float(f"{number:.4g}")


def pytest_terminal_summary(config: pytest.Config) -> None:
    for module, rows in config.stash[ROWS].items():
        show(f"{module}: peers' times over ours, in turns", rows)
        if config.getoption("--record"):
            command = f"pytest benches/python/test_{module}_bench.py --record"
            rounds = f"{ROUNDS} rounds unless a test says otherwise"
            run = run_info(command) | {"seed": SEED, "rounds": rounds}
            run["load average"] = _short(os.getloadavg()[0])
            print(f"recorded in {write(f'{module}.json', {'run': run, 'ratios': rows}).name}")
