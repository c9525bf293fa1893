"""Options for the output of `saccade slam` and `saccade drive`."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from saccade.cli.options import (
    OUTPUT,
    SEVERAL,
    FigureFormat,
    JsonOptions,
    OutputFolder,
    figure_formats,
)
from saccade.io.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from saccade.types import FloatArray, Image, MapSnapshot, Trajectory
    from saccade.viewing.snapshots import SnapshotRecorder

SNAPSHOTS = 240
"""Maximum number of snapshots of the map, for the film and the report."""


@dataclass(frozen=True, kw_only=True)
class RunOutput(JsonOptions):
    """Output folder and optional outputs of a mapping run."""

    out: OutputFolder = Path("saccade-run")
    figures: Annotated[
        list[FigureFormat] | None, OUTPUT, SEVERAL, Parameter(("--format", "-f"))
    ] = None
    """Format of the figures, png by default; several with commas."""
    film: Annotated[bool, OUTPUT] = False
    """Also write a film of the growing map."""
    live: Annotated[bool, OUTPUT, Parameter(negative=())] = False
    """Show the growing map in the rerun viewer."""
    rrd: Annotated[Path | None, OUTPUT, Parameter(metavar="FILE")] = None
    """Record the growing map for the rerun viewer."""

    @contextmanager
    def recorder(
        self,
        name: str,
        time: "FloatArray",
        odometry: "Trajectory | None" = None,
        image_at: "Callable[[int], Image | None] | None" = None,
        snapshots: int = SNAPSHOTS,
    ) -> "Iterator[SnapshotRecorder]":
        """Snapshots of the growing map, sent to rerun if requested; arguments as for `LiveMap`."""
        from saccade.viewing.live import LiveMap
        from saccade.viewing.snapshots import SnapshotRecorder

        with ExitStack() as stack:
            shows = [LiveMap(name, time, odometry, image_at)] if self.live else []
            if self.rrd is not None:
                file = stack.enter_context(atomic_write(self.rrd))
                shows.append(LiveMap(name, time, odometry, image_at, file))
            for show in shows:
                stack.callback(show.close)

            def show_all(taken: "Sequence[MapSnapshot]") -> None:
                for show in shows:
                    show(taken)

            yield SnapshotRecorder(snapshots, show_all)

    def save_figure(self, figure: "Figure", name: str) -> Path:
        """Write a figure in each format; return the file in the first format."""
        from saccade.viewing import save_figures

        return save_figures(figure, self.out / name, figure_formats(self.figures))
