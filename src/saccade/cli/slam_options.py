"""Options of `saccade slam`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from saccade.cli.options import MAP, OutputFolder, SettingsOptions
from saccade.cli.recordings import LogOptions
from saccade.cli.run_output import RunOutput
from saccade.datasets import load_map
from saccade.slam.association.rules import RULES
from saccade.types import LandmarkMap

RULES_HELP = (
    f"Data association: {'; '.join(f'{name}, {rule.summary}' for name, rule in RULES.items())}; "
    "or module:function, which pairs observations with landmarks."
)
"""Help of --association."""


@dataclass(frozen=True, kw_only=True)
class SlamOptions(SettingsOptions, LogOptions, RunOutput):
    """Options of `saccade slam`."""

    out: OutputFolder = Path("saccade-slam")
    association: Annotated[str | None, Parameter(metavar="NAME", help=RULES_HELP)] = None
    no_smooth: Annotated[bool, Parameter(negative=())] = False
    """Keep the filtered trajectory and map, without smoothing at the end."""
    map_file: Annotated[Path | None, MAP, Parameter("--map")] = None
    """Start from a map: of an earlier run (.npz), or a survey (.csv, WPILib's .json, text)."""
    save_map: Annotated[Path | None, MAP] = None
    """Save the map and the filter, for --map of a later run."""
    mode: Annotated[Literal["continue", "localize"], MAP] = "continue"
    """Use of --map: continue mapping, or localize without adding or culling landmarks."""
    start: Annotated[str | None, MAP, Parameter(metavar="WHERE")] = None
    """First pose in the frame of --map. last: the robot has not moved since (default for continue,
    unless the first scans contradict it); search: from the first scans (default for localize and
    surveys); log: as in the log; or X,Y,HEADING in meters and radians."""

    @property
    def first(self) -> str:
        """Source of the first pose."""
        searched = self.mode == "localize" or self.has_survey
        return self.start or ("search" if searched else "last")

    @property
    def has_survey(self) -> bool:
        """Whether the map is a survey, in a format of `MAP_FORMATS`, not a saved filter."""
        return self.map_file is not None and self.map_file.suffix.lower() != ".npz"

    @property
    def survey(self) -> LandmarkMap | None:
        """The map, if it is a table of landmarks."""
        return load_map(self.map_file) if self.map_file is not None and self.has_survey else None
