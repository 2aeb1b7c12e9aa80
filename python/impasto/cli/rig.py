"""The rig as stages of ``impasto fit``: strengths of lamps, distances of lamps and camera."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from impasto.cli.console import Stages
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto.fit.strengths import Strengths
    from impasto.stack import Stack


def estimated_strengths(
    stages: Stages, stack: Stack, own: dict[str, Any], threads: int | None
) -> Strengths:
    """Strengths of the lamps, as a stage; ``own``: options of the fit that follows."""
    import numpy as np

    from impasto.fit.strengths import fit_strengths

    # Strengths are not estimated with Lafortune lobes: their options do not apply.
    shared = () if own["model"] == "lafortune" else ("lobes", "index")
    options = {name: own[name] for name in shared if name in own}
    with stages.stage("strengths") as stage:
        lamps = fit_strengths(stack, **options, threads=threads, progress=stage.advance)
        low, high = np.nanmin(lamps.factor), np.nanmax(lamps.factor)
        stage.note = f"{len(lamps.factor)} lights, {low:.2f} to {high:.2f}"
    if lamps.state:
        stages.say(f"  {'':14}[dim]{len(lamps.factor)} lights{lamps.state}[/]")
    return lamps


def refined_rig(stages: Stages, stack: Stack, index: float | None, threads: int | None) -> Stack:
    """The stack with its rig refined, as a stage that says what was accepted."""
    from impasto.fit.rig_refinement import refine_rig

    accepted, found = False, None
    with stages.stage("rig") as stage:
        own = 1.45 if index is None else index
        try:
            rig = refine_rig(stack, index=own, threads=threads, progress=stage.advance)
        except ArgumentError as error:
            stage.note = f"as given: {error}"
            return stack
        found = rig.refinement
        accepted = found is not None and found.accepted
        stage.note = "refined" if accepted else "as given: nothing predicts better"
    if accepted:
        for line in str(found).splitlines():
            stages.say(f"  {'':14}[dim]{escape(line)}[/]")
    return stack._replace(rig=rig)


def rig_numbers(stack: Stack) -> dict[str, Any]:
    """What was refined, for a report."""
    found = stack.rig.refinement
    return {} if found is None else {"rig": asdict(found)}


def strength_numbers(lamps: Strengths) -> dict[str, Any]:
    """The lamps' part of a report; ``--intensities`` reads such a column."""
    return {
        "strengths": {
            "factor": lamps.factor,
            "converged": lamps.converged,
            "change": lamps.change,
            "gauge": lamps.gauge,
            "held_out": None if lamps.held_out is None else str(lamps.held_out),
        }
    }
