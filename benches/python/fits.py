"""Torrance-Sparrow through 16 observations per pixel, beside the fitters that Python people use.

    pip install "impasto[peers]"
    python benches/python/fits.py [--record]

The pixels have beta 50 to 200, gamma 0.06 to 0.36, angles to 0.57 rad, noise of 1 % of beta. Every
side gets the same samples, angles and start (the largest sample, gamma 0.15), relative tolerances
of 1e-5 and one thread. A peer gets as many pixels as it fits in about a second; rounds of both
sides alternate, the median of their ratios of processor times counts, and compilers are warm. A
peer that is not installed is left out by name.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import time
from collections.abc import Callable
from statistics import median
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

# The libraries read the variables when they load.
import numpy as np  # noqa: E402
from record import ROOT, run_info, show, write  # noqa: E402

import impasto  # noqa: E402

OBSERVATIONS, SEED, TOLERANCE, ROUNDS = 16, 17, 1e-5, 5
OURS = 200_000
"""Pixels that our side fits per round, a fifth of a second or less."""

Fit = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""``phi, samples (obs, pixel)`` to ``(pixel, 2)``: beta and gamma."""


def pixels(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles and samples ``(obs, pixel)`` float32."""
    rng = np.random.default_rng(SEED)
    beta, gamma = rng.uniform(50, 200, count), rng.uniform(0.06, 0.36, count)
    phi = rng.uniform(0.0, 0.57, (OBSERVATIONS, count))
    lobe = np.exp(-np.log(2) * (phi / gamma) ** 2)
    samples = beta * (lobe + 0.01 * rng.standard_normal(phi.shape))
    return phi.astype(np.float32), samples.astype(np.float32)


def starts(samples: np.ndarray) -> np.ndarray:
    """Beta and ln k, with ``k = ln 2 / gamma^2``: what every peer fits."""
    start = np.full((samples.shape[1], 2), np.log(np.log(2) / 0.15**2))
    start[:, 0] = samples.max(axis=0)
    return start


def places(found: np.ndarray) -> np.ndarray:
    """Beta and gamma of beta and ln k."""
    return np.stack([found[:, 0], np.sqrt(np.log(2) * np.exp(-found[:, 1]))], axis=1)


def ours(phi: np.ndarray, samples: np.ndarray, threads: int = 1) -> np.ndarray:
    fit = impasto.fit_highlight(phi, samples, threads=threads)
    return np.stack([fit.beta, fit.gamma], axis=1)


def scipy_curve_fit() -> Fit:
    from scipy.optimize import curve_fit

    def model(squared: np.ndarray, beta: float, log_k: float) -> np.ndarray:
        return beta * np.exp(-np.exp(log_k) * squared)

    def slopes(squared: np.ndarray, beta: float, log_k: float) -> np.ndarray:
        exponent = np.exp(log_k) * squared
        lobe = np.exp(-exponent)
        return np.stack([lobe, -exponent * beta * lobe], axis=1)

    def fit(phi: np.ndarray, samples: np.ndarray) -> np.ndarray:
        squared, values = phi.T.astype(np.float64) ** 2, samples.T.astype(np.float64)
        options = {"jac": slopes, "ftol": TOLERANCE, "xtol": TOLERANCE, "gtol": TOLERANCE}
        return places(
            np.array(
                [
                    curve_fit(model, x, y, p0=start, **options)[0]
                    for x, y, start in zip(squared, values, starts(samples), strict=True)
                ]
            )
        )

    return fit


def lumafit() -> Fit:
    import numba
    from lumafit import levenberg_marquardt_core

    @numba.njit(fastmath=True)
    def model(p, squared):  # type: ignore[no-untyped-def]
        return p[0] * np.exp(-np.exp(p[1]) * squared)

    @numba.njit(fastmath=True)
    def slopes(p, squared):  # type: ignore[no-untyped-def]
        exponent = np.exp(p[1]) * squared
        lobe = np.exp(-exponent)
        return np.stack((lobe, -exponent * p[0] * lobe), axis=1)

    @numba.njit
    def all_pixels(squared, values, start):  # type: ignore[no-untyped-def]
        # levenberg_marquardt_pixelwise knows one start and one phi for all pixels.
        found = np.empty((len(values), 2))
        for i in range(len(values)):
            found[i] = levenberg_marquardt_core(
                model,
                start[i],
                values[i],
                None,
                100,
                TOLERANCE,
                TOLERANCE,
                TOLERANCE,
                1e-2,
                3.0,
                2.0,
                1e-8,
                True,
                slopes,
                (squared[i],),
            )[0]
        return found

    def fit(phi: np.ndarray, samples: np.ndarray) -> np.ndarray:
        squared = np.ascontiguousarray(phi.T.astype(np.float64) ** 2)
        values = np.ascontiguousarray(samples.T.astype(np.float64))
        return places(all_pixels(squared, values, starts(samples)))

    return fit


def jaxopt() -> Fit:
    import jax
    import jax.numpy as jnp
    from jaxopt import LevenbergMarquardt

    def residual(p: Any, squared: Any, values: Any) -> Any:
        return p[0] * jnp.exp(-jnp.exp(p[1]) * squared) - values

    solver = LevenbergMarquardt(
        residual,
        maxiter=100,
        tol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=TOLERANCE,
        solver="cholesky",
        materialize_jac=True,
    )
    run = jax.jit(jax.vmap(lambda p, x, y: solver.run(p, x, y).params))

    def fit(phi: np.ndarray, samples: np.ndarray) -> np.ndarray:
        found = run(starts(samples).astype(np.float32), phi.T**2, samples.T)
        return places(np.asarray(found, dtype=np.float64))

    return fit


def xarray_curvefit() -> Fit:
    import xarray as xr

    def model(squared: np.ndarray, beta: float, log_k: float) -> np.ndarray:
        return beta * np.exp(-np.exp(log_k) * squared)

    def fit(phi: np.ndarray, samples: np.ndarray) -> np.ndarray:
        dims = ("obs", "pixel")
        data = xr.DataArray(samples.astype(np.float64), dims=dims)
        squared = xr.DataArray(phi.astype(np.float64) ** 2, dims=dims)
        start = starts(samples)
        found = data.curvefit(
            squared,
            model,
            reduce_dims="obs",
            p0={
                n: xr.DataArray(start[:, i], dims="pixel") for i, n in enumerate(("beta", "log_k"))
            },
            kwargs={"ftol": TOLERANCE, "xtol": TOLERANCE, "gtol": TOLERANCE},
        )
        return places(found.curvefit_coefficients.values)

    return fit


PEERS: dict[str, tuple[str, Callable[[], Fit], int]] = {
    "scipy.optimize.curve_fit": ("scipy", scipy_curve_fit, 1000),
    "lumafit": ("lumafit", lumafit, 4000),
    "jaxopt, vmap": ("jaxopt", jaxopt, 8000),
    "xarray.curvefit": ("xarray", xarray_curvefit, 500),
}
"""Package, fitter, pixels per round."""


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Processor seconds of all threads, and the answer."""
    start = time.process_time()
    answer = work()
    return time.process_time() - start, answer


def race(peer: Fit, count: int) -> dict[str, float]:
    """Rates in the round of median ratio, and how far apart the results are."""
    phi, samples = pixels(OURS)
    few = np.ascontiguousarray(phi[:, :count]), np.ascontiguousarray(samples[:, :count])
    theirs = peer(*few)
    found = ours(phi, samples)[:count]
    rounds = []
    for _ in range(ROUNDS):
        mine, _found = timed(lambda: ours(phi, samples))
        other, _found = timed(lambda: peer(*few))
        rounds.append((other / count) / (mine / OURS))
    lobes = found[:, 0] > 0  # not where none helps to explain the samples
    apart = np.abs(theirs[lobes] / found[lobes] - 1).max(axis=1)
    return {
        "ratio": median(rounds),
        "least": min(rounds),
        "most": max(rounds),
        "apart": float(np.median(apart)),
    }


def scaling() -> float:
    """Twice the processor time of one thread over that of two: what two free cores would give.

    Elapsed time would tell it directly, but only where nobody else computes.
    """
    phi, samples = pixels(OURS * 5)
    rounds = []
    for _ in range(ROUNDS):
        one, two = (timed(lambda n=n: ours(phi, samples, n))[0] for n in (1, 2))
        rounds.append(2 * one / two)
    return median(rounds)


def accuracy(count: int = 2000) -> list[dict[str, Any]]:
    """Errors of the default against the double-precision optimum, in standard deviations.

    The optimum is SciPy's (MINPACK) with tolerances of 1e-15, from where the fit ended: whether
    that is the best minimum is the other table's question. Standard deviations are those of the
    optimum's Jacobian and of the noise that was put in (Cramer and Rao's bound).
    """
    from scipy.optimize import least_squares

    phi, samples = pixels(count)
    found = impasto.fit_highlight(phi, samples, threads=1)
    kept = np.flatnonzero(found.status == impasto.Status.FITTED)
    truth = np.random.default_rng(SEED).uniform(50, 200, count)
    errors = []
    for i in kept:
        x, y = phi[:, i].astype(np.float64) ** 2, samples[:, i].astype(np.float64)

        def lobe(p: np.ndarray, x: np.ndarray = x) -> np.ndarray:
            return np.exp(-np.log(2) * x / p[1] ** 2)

        def residual(p: np.ndarray, y: np.ndarray = y) -> np.ndarray:
            return p[0] * lobe(p) - y

        def slopes(p: np.ndarray, x: np.ndarray = x) -> np.ndarray:
            e = lobe(p)
            return np.stack([e, p[0] * e * 2 * np.log(2) * x / p[1] ** 3], axis=1)

        start = np.array([found.beta[i], found.gamma[i]], np.float64)
        options = {"method": "lm", "x_scale": start, "ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
        best = least_squares(residual, start, slopes, **options).x
        jacobian = slopes(best)
        spread = 0.01 * truth[i] * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
        errors.append(np.abs(start - best) / spread)
    return [
        {
            "quantity": name,
            "median": float(np.median(column)),
            "p99": float(np.percentile(column, 99)),
            "worst": float(column.max()),
            "fitted": f"{len(kept)} of {count}",
        }
        for name, column in zip(("beta", "gamma"), np.array(errors).T, strict=True)
    ]


def cargo(*arguments: str) -> str:
    """What the Rust benchmark prints."""
    command = ["cargo", "bench", "-q", "-p", "impasto-benches", "--bench", "fits", "--", *arguments]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout


def rust() -> list[dict[str, Any]]:
    """The table of ``cargo bench --bench fits``: lanes against a port of MINPACK."""
    lines = [line.strip("| ").split(" | ") for line in cargo().splitlines() if line[:2] == "| "]
    head, *rows = lines
    found: list[dict[str, Any]] = []
    for cells in rows:
        numbers = [float(cell.removesuffix(" %")) for cell in cells[1:]]
        found.append({"problem": cells[0], **dict(zip(head[1:], numbers, strict=True))})
    return found


def overhead() -> float:
    """Rate of the Python call over that of the bare lanes in Rust, in alternating rounds."""
    phi, samples = pixels(OURS)
    ratios = []
    for _ in range(ROUNDS):
        rate = float(cargo("kernel"))
        ratios.append(OURS / timed(lambda: ours(phi, samples))[0] / rate)
    return median(ratios)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", action="store_true", help="write benches/results/fits.json")
    record = parser.parse_args().record
    lanes = rust()
    show("Lanes, single precision, against MINPACK in Rust, double; one thread", lanes)
    peers = []
    for name, (package, make, count) in PEERS.items():
        if importlib.util.find_spec(package) is None:
            print(f"{name}: {package} is not installed (pip install impasto[peers])")
            continue
        peers.append({"peer": name, **race(make(), count)})
    if peers:
        show("impasto.fit_highlight over peers; one thread", peers)
    spread = accuracy()
    show("Errors of the default, in standard deviations", spread)
    calls = [
        {"call": "Python call over bare lanes, one thread", "ratio": overhead()},
        {"call": "two threads over one, by processor time", "ratio": scaling()},
    ]
    show("Around the lanes", calls)
    if record:
        content = {"run": run_info("python benches/python/fits.py --record"), "seed": SEED}
        content |= {"lanes": lanes, "peers": peers, "accuracy": spread, "calls": calls}
        print(f"\nwrote {write('fits.json', content)}")


if __name__ == "__main__":
    main()
