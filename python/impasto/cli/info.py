"""``impasto info``: the installation, or the contents of a result."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from impasto._internal.wording import counted
from impasto.cli import console
from impasto.cli.options import Flag
from impasto.io.results import result_file

LABEL_WIDTH = 26
SAMPLED = 2**20
"""Pixels of a store, about, of which medians are taken; its statuses are counted in all."""


def info(
    result: Annotated[Path | None, Parameter(name=["RESULT"])] = None,
    /,
    *,
    json: Flag = False,
) -> None:
    """Show what is installed, or what a result contains.

    Parameters
    ----------
    result
        The --out folder of impasto fit or demo, its report.json, an sbrdf.npz, or the .zarr of
        impasto job run; photographs in the .zarr of impasto ingest; a session.toml; or an RTI file
        (.ptm, .rti, a folder of relight); default: the installation.
    json
        Print JSON for programs.
    """
    facts = _installation() if result is None else _facts(result)
    if json:
        console.print_json(facts)
        return
    page = console.stdout()
    width = max(LABEL_WIDTH, 2 + max(map(len, facts)))
    for name, value in facts.items():
        for index, line in enumerate(_lines(value)):
            label = name.replace("_", " ") if index == 0 else ""
            page.out(f"{label:<{width}}{line}")


def _installation() -> dict[str, Any]:
    from impasto.report import versions

    return versions()


def _facts(path: Path) -> dict[str, Any]:
    from impasto.cli.folder import REPORT
    from impasto.io.rti import is_relightable, read_relightable
    from impasto.io.session.stored import is_stack

    if _is_session(path):
        return _session(path)
    if is_relightable(path) and not (path / REPORT).is_file():
        return read_relightable(path).report()
    if is_stack(path):
        return _stack(path)
    return _result(path)


def _stack(path: Path) -> dict[str, Any]:
    """The photographs in a store of impasto ingest; of their samples a chunk is read."""
    import impasto
    from impasto.cli.fit import band_words
    from impasto.io.session.stored import StoredStack

    stored = StoredStack(path)
    (observations, bands, rows, columns), dtype = stored.samples.shape, stored.samples.dtype
    stack = impasto.read_stack(path, region=(0, 0, 1, 1))
    near = int(stack.rig.near.sum())
    return {
        "photographs": f"{observations} of {columns} x {rows} pixels, {band_words(bands)}",
        "bands": ", ".join(stack.bands),
        "lights": ", ".join(
            f"{count} {kind}"
            for count, kind in ((near, "near"), (observations - near, "distant"))
            if count
        ),
        "samples": f"{dtype.name}, tone curve {stack.encoding.curve}, tiles of {stored.tile}",
        "mask": "none" if stack.mask is None else "yes",
        "inputs": _few(stored.inputs) if stored.inputs else "samples in memory",
    }


def _is_session(path: Path) -> bool:
    from impasto.cli.folder import REPORT
    from impasto.io.session_toml import is_session

    return is_session(path) and not (path / REPORT).is_file()


def _session(path: Path) -> dict[str, Any]:
    """Every key of a session that has a value; of sections the number of their lines."""
    from impasto.io.session_toml import KEYS, read_session

    session = read_session(path)
    facts: dict[str, Any] = {"session": str(session.path)}
    for key in KEYS:
        value = getattr(session, key.attribute)
        if isinstance(value, dict):
            value = counted(len(value), "file") if value else None
        elif isinstance(value, tuple):
            value = ", ".join(map(str, value))
        if value is not None and value is not False:
            facts[key.name] = value
    return facts


def _result(path: Path) -> dict[str, Any]:
    own = result_file(path)
    if path.suffix.lower() == ".npz" or (path.is_dir() and own == path):
        return _archive(path)
    from impasto.cli.fit import band_words
    from impasto.cli.folder import REPORT, read_report

    folder = path.parent if path.name == REPORT else path
    report = read_report(folder)
    results, versions = report.get("results", {}), report["versions"]
    lost, changed = _compared(folder, report.get("outputs", []))
    facts: dict[str, Any] = {
        "made_by": f"impasto {report['command']}, version {versions.get('impasto', 'unknown')}"
    }
    if "shape" in results:
        observations, bands, rows, columns = results["shape"]
        facts["stack"] = f"{observations} of {columns} x {rows} pixels, {band_words(bands)}"
    if report.get("inputs"):
        facts["inputs"] = _few([entry["file"] for entry in report["inputs"]])
    if "strengths" in results:
        facts["strengths"] = _strengths(results["strengths"])
    facts["status"] = _counts(results.get("status", {}))
    facts |= _gloss(results)
    for name in ("sigma_degrees_median", "residual_median"):
        if name in results:
            facts[name] = results[name]
    facts |= {f"truth_{key}": value for key, value in results.get("truth", {}).items()}
    facts["notes"] = report.get("notes", [])
    facts["seconds"] = round(sum(report.get("timings_s", {}).values()), 1)
    facts["files"] = f"{len(report.get('outputs', []))}, all as written"
    if lost or changed:
        facts["files"] = [f"{name} is missing" for name in lost]
        facts["files"] += [f"{name} has been changed" for name in changed]
    return {name: value for name, value in facts.items() if value not in ([], {}, None)}


def _archive(path: Path) -> dict[str, Any]:
    import impasto
    from impasto.cli.fit import band_words
    from impasto.fit.result import PerPixelSbrdf
    from impasto.report import status_counts

    facts: dict[str, Any] = {}
    if path.is_dir():
        stored = impasto.open_sbrdf(path)
        rows, columns = stored.shape
        statuses: Counter[str] = Counter()
        for window in stored.windows():
            statuses.update(status_counts(stored.map("status", *window)))
        step = max(1, math.isqrt(rows * columns // SAMPLED))
        sbrdf = stored.every(step)
        if stored.factors:
            facts["scales"] = ", ".join(f"1/{factor}" for factor in stored.factors)
        if step > 1 and isinstance(sbrdf, PerPixelSbrdf):
            facts["medians"] = f"of every {step}th row and column"
    else:
        sbrdf = impasto.load_sbrdf(path)
        rows, columns = sbrdf.shape
        statuses = Counter(status_counts(sbrdf.status))
    return {
        "size": f"{columns} x {rows} pixels, {band_words(len(sbrdf.bands))}",
        "bands": ", ".join(sbrdf.bands),
        "lights": len(sbrdf.rig),
        "normals": sbrdf.normals.method,
        "status": _counts(statuses),
        **(_gloss(sbrdf.report()) if _searched(sbrdf) else {"gloss": "not fitted"}),
        **facts,
    }


def _searched(sbrdf: Any) -> bool:
    """Whether a lobe was looked for: the search for one of the painting leaves its steps."""
    from impasto.fit.pooled import PooledSbrdf

    return not isinstance(sbrdf, PooledSbrdf) or len(sbrdf.path) > 0


def _gloss(numbers: dict[str, Any]) -> dict[str, Any]:
    """The gloss in the report of a result of any model."""
    names = ("verdict", "beta", "gamma_degrees", "index")
    facts = {name: numbers[name] for name in names if name in numbers}
    if "lobes_per_pixel" in numbers:
        facts["lobes"] = f"{_number(numbers['lobes_per_pixel'])} lobes per pixel"
    for name, values in numbers.items():
        if name.endswith("_median") and isinstance(values, list):
            facts[name] = ", ".join(_number(value) for value in values)
    if "segments" in numbers:
        facts["segments"] = [
            f"{one['label']}: {one['pixels']} pixels, beta {one['beta']:.4g}, gamma "
            f"{one['gamma_degrees']:.3g} degrees, {one['verdict']}"
            for one in numbers["segments"]
        ]
    return facts


def _strengths(lamps: dict[str, Any]) -> str:
    """The estimated strengths of the lamps, in one line."""
    factor = lamps["factor"]
    known = [one for one in factor if one is not None]
    last = max(abs(one) for one in lamps["change"] if one is not None)
    state = "" if lamps["converged"] else f", the last round changed by up to {100 * last:.1f} %"
    if len(known) < len(factor):
        state += f", {len(factor) - len(known)} unknown"
    return f"{len(factor)} lights, {min(known):.2f} to {max(known):.2f}{state}"


def _compared(folder: Path, outputs: list[dict[str, Any]]) -> tuple[list[str], list[str]]:
    """Missing files, and files whose hash differs from the report's."""
    from impasto.report import file_entry

    lost = [entry["file"] for entry in outputs if not (folder / entry["file"]).is_file()]
    changed = [
        entry["file"]
        for entry in outputs
        if entry["file"] not in lost
        and file_entry(folder / entry["file"])["sha256"] != entry["sha256"]
    ]
    return lost, changed


def _counts(counts: dict[str, int]) -> list[str]:
    total = sum(counts.values())
    order = sorted(counts.items(), key=lambda item: -item[1])
    return [f"{name.replace('_', ' ')} {100 * n / total:.2f} % ({n})" for name, n in order]


def _few(names: list[str]) -> str:
    shown = ", ".join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"


def _lines(value: Any) -> list[str]:
    if isinstance(value, list):
        return [str(entry) for entry in value] or ["none"]
    if isinstance(value, dict):
        return [f"{name} {_number(entry)}" for name, entry in value.items()]
    return [_number(value)]


def _number(value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, float) and math.isnan(value):
        return "none"  # the median of no lobes
    return f"{value:.4g}" if isinstance(value, float) else str(value)
