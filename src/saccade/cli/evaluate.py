"""`saccade evaluate`: the commands that score results."""

from inspect import getdoc

import typer

from saccade.cli import evaluate_features as features
from saccade.cli import evaluate_fixations as fixations
from saccade.cli import evaluate_gaze as gaze
from saccade.cli import evaluate_scanpaths as scanpaths
from saccade.cli import evaluate_trajectory as trajectory
from saccade.cli.options import Command

evaluate = typer.Typer(
    help="Evaluate against human fixations, other implementations and ground truth.",
    no_args_is_help=True,
)
for command, meaning, options in (
    (
        fixations.fixations,
        fixations.MEANING,
        "fixations --images photos --fixations fixations.csv",
    ),
    (
        scanpaths.scanpaths,
        scanpaths.MEANING,
        "scanpaths --images photos --fixations fixations.csv",
    ),
    (features.features, features.MEANING, "features --pairs oxford --detector opencv"),
    (gaze.gaze, gaze.MEANING, "gaze --map known --seeds 5"),
    (
        trajectory.trajectory,
        trajectory.MEANING,
        "trajectory mapped/trajectory.tum --truth groundtruth.tum",
    ),
):
    evaluate.command(
        cls=Command,
        help=f"{getdoc(command)}\n\n{meaning}",
        epilog=f"Example: saccade evaluate {options}",
    )(command)
