"""A study as text, as files and as a figure."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from impasto._internal.extras import need
from impasto.effort import Effort
from impasto.io.files import atomic_bytes
from impasto.report import versions
from impasto.study import table
from impasto.study.sweep import Study
from impasto.study.trials import Setting, Trial

NOTE = (
    "*time*: predicted wall-clock time of the whole stack. *error*: root mean square error of "
    "held-out photographs, as a share of their root mean square. *front*: settings that no other "
    "beats in both."
)
BLUE, GREY = "#0072b2", "#a0a0a0"


def markdown(study: Study) -> str:
    """The suggestion and the table as Markdown."""
    observations, bands, rows, columns = study.shape
    head = (
        f"# Accuracy and time\n\n{observations} photographs of {columns} x {rows} pixels, "
        f"{bands} {'band' if bands == 1 else 'bands'}.\n\n{study.suggestion}\n"
    )
    return f"{head}\n{table.markdown(study.trials, study.front)}\n\n{NOTE}\n"


def to_dict(study: Study) -> dict[str, Any]:
    """What ``study.json`` holds: versions, shape, trials (``front``: yes or no), suggestion."""
    front = study.front
    suggestion = study.suggestion
    return {
        "versions": versions(),
        "shape": list(study.shape),
        "trials": [_trial(trial) | {"front": trial in front} for trial in study.trials],
        "suggestion": {
            "options": _options(suggestion.options),
            "seconds": suggestion.seconds,
            "error": suggestion.error,
            "met": suggestion.met,
        },
    }


def write(study: Study, out: str | Path, *, figure: bool = True) -> list[Path]:
    """Write ``study.json``, ``study.md`` and the figure ``front.svg`` and ``front.png``.

    Parameters
    ----------
    study
        What :func:`impasto.study.run` returned.
    out
        An existing folder; files of these names are replaced.
    figure
        Whether to draw; this needs matplotlib.

    Returns
    -------
    list
        Paths of the files.
    """
    out = Path(out)
    if figure:
        need("matplotlib", "plot", "the figure of a study (figure=False does without)")
    content = json.dumps(to_dict(study), indent=1, allow_nan=False) + "\n"
    written = []
    for name, body in (("study.json", content), ("study.md", markdown(study))):
        atomic_bytes(out / name, body.encode("utf-8"))
        written.append(out / name)
    return written + (_draw(study, out / "front") if figure else [])


def _trial(trial: Trial) -> dict[str, Any]:
    return asdict(trial) | {"options": _options(trial.options)}


def _options(options: Setting) -> dict[str, Any]:
    return {k: v.to_dict() if isinstance(v, Effort) else v for k, v in options.items()}


def _draw(study: Study, stem: Path) -> list[Path]:
    """Error against time: every trial, and the front as a line; its settings are listed below."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # No date and constant ids: the same figure gives the same file.
    formats: dict[str, dict[str, Any]] = {".svg": {"metadata": {"Date": None}}, ".png": {}}
    with mpl.rc_context({"font.size": 8.5, "svg.fonttype": "none", "svg.hashsalt": "impasto"}):
        figure = Figure(figsize=(6.4, 4.0 + 0.16 * len(study.front)))
        figure.set_layout_engine("constrained")
        axes = figure.add_subplot()
        points = [(trial.seconds, 100.0 * trial.error) for trial in study.trials]
        axes.plot(*zip(*points, strict=True), "o", ms=4, color=GREY, ls="", label="other settings")
        front = [(trial.seconds, 100.0 * trial.error) for trial in study.front]
        axes.plot(*zip(*front, strict=True), "o-", ms=5, color=BLUE, lw=1.3, label="Pareto front")
        for number, (trial, at) in enumerate(zip(study.front, front, strict=True), start=1):
            axes.annotate(str(number), at, xytext=(3, 4), textcoords="offset points", color=BLUE)
            axes.plot([], [], " ", label=f"{number}  {table.call(trial.options)}")
        axes.set_xlabel("predicted time of the whole stack, s")
        axes.set_ylabel("error of held-out photographs, %")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.margins(x=0.1, y=0.1)
        for axis in (axes.xaxis, axes.yaxis):
            _plain(axis)
        figure.legend(loc="outside lower left", frameon=False)
        paths = []
        for suffix, more in formats.items():
            path = stem.with_name(stem.name + suffix)
            figure.savefig(path, dpi=150, **more)
            paths.append(path)
    return paths


def _plain(axis: Any) -> None:
    """Plain numbers on a logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    low, high = axis.get_view_interval()
    subs = (1.0, 2.0, 5.0) if high > 10.0 * low else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
