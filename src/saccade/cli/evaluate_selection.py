"""`saccade evaluate selection`: which choice of landmarks makes the best map."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from saccade.cli.options import Json

if TYPE_CHECKING:
    from saccade.frames import Drive
    from saccade.visual import VisualConfig

CHOICES = {
    "strength": {"selection": "strength"},
    "random": {"selection": "random"},
    "range": {"selection": "range"},
    "contrast": {"selection": "contrast"},
    "symmetry": {"selection": "symmetry"},
    "must": {"detector": "must", "selection": "strength"},
    "symroid": {"detector": "symroid", "selection": "strength"},
}
"""What is compared: SIFT chosen in five ways, and two other detectors by strength."""
SCORES = ("found_again", "association_precision", "ate_m", "end_m", "inside_3sigma", "landmarks")
"""Columns of the table."""


def selection(
    drives: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[SEQUENCE]...",
            help="Recorded drives with truth, driven out and back; none for the simulator.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for what is made; runs in it are kept.")
    ] = Path("saccade-selection"),
    budgets: Annotated[
        list[int] | None,
        typer.Option("--budget", min=1, help="New landmarks per frame; may be repeated."),
    ] = None,
    choices: Annotated[
        list[str] | None, typer.Option("--choice", help=f"{', '.join(CHOICES)}; may be repeated.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each, with other noise.")] = 5,
    frames: Annotated[int, typer.Option(min=8, help="Of each drive.")] = 600,
    as_json: Json = False,
) -> None:
    """Choose landmarks in several ways, at equal budgets, and see which maps are best.

    Found again: share of the times that a landmark should have been in view after it was out of
    sight, and was recognized. Means over the seeds with 95 % bootstrap intervals. Each run is
    kept in --out: an evaluation that was interrupted goes on, and more seeds add to it.
    """
    from saccade.cli.output import print_json, print_table, tracked
    from saccade.errors import require

    wanted = choices or list(CHOICES)
    for each in wanted:
        require(each in CHOICES, "choice", f"one of {', '.join(CHOICES)}", each)
    sources: list[Path | None] = [*drives] if drives else [None]
    runs = [
        (source, budget, choice, seed)
        for source in sources
        for budget in budgets or [1, 2, 4, 8]
        for choice in wanted
        for seed in range(seeds)
    ]
    found = [
        _kept(out, source, budget, choice, seed, frames)
        for source, budget, choice, seed in tracked(runs, "driving", len(runs))
    ]
    rows = list(_summaries(found))
    if as_json:
        print_json({"frames": frames, "seeds": seeds, "rows": rows})
        return
    columns = ["", "budget", *(name.replace("_", " ") for name in SCORES)]
    shown = [
        [row["choice"], str(row["budget"]), *map(_shown, map(row.get, SCORES))] for row in rows
    ]
    print_table("landmarks chosen, mean and 95 % interval", columns, shown)


def _kept(
    out: Path, source: Path | None, budget: int, choice: str, seed: int, frames: int
) -> dict[str, Any]:
    """One run, read where it was made before."""
    import json

    from saccade.cli.output import write_text

    name = "simulator" if source is None else source.resolve().name
    path = out / f"{name}-{frames}-{budget}-{choice}-{seed}.json"
    if path.exists():
        kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return kept
    row = {"drive": name, "budget": budget, "choice": choice, "seed": seed}
    row |= _scored(_opened(source, seed, frames), _settings(budget, choice, seed))
    write_text(path, json.dumps(row, indent=2) + "\n")
    return row


def _opened(source: Path | None, seed: int, frames: int) -> "Drive":
    from saccade import datasets
    from saccade.evaluation.palindrome import PalindromeConfig, palindrome
    from saccade.simulation import simulate_drive

    if source is None:
        return simulate_drive(seed=seed).until(frames)
    return palindrome(datasets.load_drive("auto", source), PalindromeConfig(frames), seed)


def _settings(budget: int, choice: str, seed: int) -> "VisualConfig":
    from dataclasses import replace

    from saccade.visual import VisualConfig

    chosen: dict[str, Any] = CHOICES[choice]
    return replace(VisualConfig(new_per_frame=budget, in_view=10**5, seed=seed), **chosen)


def _scored(drive: "Drive", settings: "VisualConfig") -> dict[str, Any]:
    from saccade import visual
    from saccade.cli.drive_files import figures

    row = figures(drive, visual.run(drive, settings))
    looked = row["recognized"] + row["missed"]
    row["found_again"] = row["recognized"] / looked if looked else None
    return {name: row[name] for name in (*SCORES, "landmarks_seen", "ms_per_frame")}


def _summaries(found: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Mean, low and high of each score over the seeds of one choice at one budget."""
    import numpy as np

    from saccade.evaluation.intervals import mean_interval

    kinds = dict.fromkeys((row["drive"], row["budget"], row["choice"]) for row in found)
    for drive, budget, choice in kinds:
        same = [
            r for r in found if (r["drive"], r["budget"], r["choice"]) == (drive, budget, choice)
        ]
        summary: dict[str, Any] = {"drive": drive, "budget": budget, "choice": choice}
        for name in SCORES:
            values = np.array([r[name] for r in same if r[name] is not None], float)[:, None]
            if len(values) == 0:
                summary[name] = None
                continue
            low, high = mean_interval(values, 0.95, seed=0)
            summary[name] = [float(values.mean()), float(low[0]), float(high[0])]
        yield summary


def _shown(score: list[float] | None) -> str:
    if score is None:
        return ""
    mean, low, high = score
    return f"{mean:.3f} [{low:.3f} {high:.3f}]"
