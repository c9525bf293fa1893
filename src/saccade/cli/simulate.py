"""`saccade simulate`: the commands that simulate worlds with ground truth."""

import typer

from saccade.cli.options import Command
from saccade.cli.simulate_drive import drive
from saccade.cli.simulate_world import world

simulate = typer.Typer(help="Simulate worlds with ground truth.", no_args_is_help=True)
simulate.command(
    cls=Command, epilog="Example: saccade simulate world --preset car --seed 7 --out drive"
)(world)
simulate.command(
    cls=Command, epilog="Example: saccade simulate drive --preset repeated --seed 7 --out ring"
)(drive)
