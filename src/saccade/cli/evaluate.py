"""`saccade evaluate`: the commands that score results."""

import typer

from saccade.cli.evaluate_consistency import consistency
from saccade.cli.evaluate_features import features
from saccade.cli.evaluate_fixations import fixations
from saccade.cli.evaluate_places import places
from saccade.cli.evaluate_selection import selection

evaluate = typer.Typer(
    help="Evaluate against human fixations, other implementations and ground truth.",
    no_args_is_help=True,
)
for command, options in (
    (fixations, "fixations --images photos --fixations fixations.csv"),
    (features, "features --pairs oxford --detector opencv"),
    (consistency, "consistency --preset loop --runs 20"),
    (places, "places hallway --lap 40"),
    (selection, "selection --budget 2 --seeds 5"),
):
    evaluate.command(epilog=f"Example: saccade evaluate {options}")(command)
