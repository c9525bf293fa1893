"""`saccade demo`: attention, matching and SLAM on data that ships with the package."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from saccade.cli.options import JsonOptions, OutputFolder
from saccade.cli.output import Result, Table, print_message, progress_bar
from saccade.errors import OutputError
from saccade.io.files import joining_results, results_in

if TYPE_CHECKING:
    from saccade.viewing.report import Part, ReportBuilder

LEAD = (
    "Attention selects where to look in an image, interest points select what to keep, the "
    "filter turns them into landmarks, and the result is a map. Photograph of a cat: Stefan van "
    "der Walt, CC0; of a hallway: RTAB-Map samples, BSD-3. Log of Victoria Park, Sydney: J. "
    "Guivant and E. Nebot, as distributed with GTSAM, BSD. The last drive is simulated: a robot "
    "points its camera where it expects the most information about its pose and the map."
)
SEED = 0
"""Seed of the simulated drive."""
FRAMES = 80
"""Number of frames of the simulated drive."""
FRAMES_PER_LAP = 56
"""Number of frames of one of its laps."""

Rows: TypeAlias = dict[str, dict[str, Any]]
"""Rows for --json, by command."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions(JsonOptions):
    """Options of `saccade demo`."""

    out: OutputFolder = Path("saccade-demo")


def demo(options: DemoOptions = DemoOptions()) -> Result:
    """Run look, match, slam and drive on built-in data, and write index.html.

    All data ships with the package. The first run takes up to a minute longer,
    to compile.

    Example: saccade demo --out saccade-demo
    """
    from saccade.viewing.report import ReportBuilder
    from saccade.workers import DIED, count_workers, run_blocks

    out = options.out
    done: dict[Callable[..., Rows], tuple[Rows, Sequence[Part]]] = {}
    with (
        results_in(out),
        progress_bar("images, a log and a simulated drive", len(EXAMPLES)) as progress,
    ):
        runs = run_blocks(partial(run_example, out), EXAMPLES, workers=count_workers(len(EXAMPLES)))
        for example, found in runs:
            if found is None:
                raise OutputError(f"{out}: {DIED}")
            done[example] = found
            progress(len(done))
        builder = ReportBuilder("saccade demo", LEAD)
        for part in (part for example in EXAMPLES for part in done[example][1]):
            builder.add(partial(copy, part))  # with its HTML
        page = builder.write(out / "index.html")
    print_message(f"open {page} in a browser; then try: saccade look YOUR_PHOTO.jpg")
    rows = {name: row for example in EXAMPLES for name, row in done[example][0].items()}
    look, match, slam, drive = (rows[name] for name in ("look", "match", "slam", "drive"))
    cells = [
        [look["picture"], f"{len(look['scanpath'])} fixations"],
        [match["picture"], f"{match['matches']} matches"],
        [slam["files"]["picture"], f"{slam['landmarks']} landmarks by laser"],
        [drive["files"]["film"], f"{drive['landmarks']} landmarks by camera"],
        [str(page), "all results, interactive"],
    ]
    table = Table("saccade demo", ["file", "content"], cells)
    return Result({"page": str(page), **rows}, [table])


def run_example(
    out: Path, example: Callable[[Path, Path, "ReportBuilder"], Rows]
) -> tuple[Rows, Sequence["Part"]]:
    """Runs an example, perhaps in a process of its own; its rows, and its parts of the report."""
    from saccade.cli import prepare_libraries
    from saccade.viewing.report import ReportBuilder

    prepare_libraries()
    builder = ReportBuilder("", "")
    with joining_results(out), as_file(files("saccade") / "data") as data:
        rows = example(data, out, builder)
    return rows, builder.parts


def _look_and_match(data: Path, out: Path, builder: "ReportBuilder") -> Rows:
    from saccade.cli.look import LookOptions
    from saccade.cli.look_image import analyze_image
    from saccade.cli.match import MatchOptions, match_images
    from saccade.keypoints import Sift

    photo = data / "chelsea.jpg"
    looking = LookOptions(keypoints=True, out=out)
    attention = looking.attention_model(looking.model, free_viewing=True)
    look, _ = analyze_image(photo, photo.stem, attention, looking, builder)
    hallway = data / "hallway_1.jpg", data / "hallway_2.jpg"
    return {
        "look": look,
        "match": match_images(Sift(), hallway, MatchOptions(out=out), builder),
    }


def _map_a_log(data: Path, out: Path, builder: "ReportBuilder") -> Rows:
    from saccade.cli.slam_options import SlamOptions
    from saccade.cli.slam_run import map_log

    options = SlamOptions(out=out)
    log = options.load(data / "victoria_park.txt")
    return {"slam": map_log(log, options, _report_nothing, builder)}


def _map_a_drive(_: Path, out: Path, builder: "ReportBuilder") -> Rows:
    """A simulated drive through a hall with few posters."""
    from saccade.cli.drive_run import write_results
    from saccade.cli.run_output import RunOutput
    from saccade.simulation import DriveConfig
    from saccade.simulation.gaze_drive import SETTINGS, gaze_drive
    from saccade.viewing.snapshots import SnapshotRecorder

    hall = replace(
        DriveConfig.hall(),
        size=(13.0, 10.5),
        frames=FRAMES,
        frames_per_lap=FRAMES_PER_LAP,
        color=True,
    )
    settings, recorder = replace(SETTINGS, egomotion="wheels"), SnapshotRecorder(FRAMES // 2)
    output = RunOutput(out=out / "drive", film=True)
    drive, result = gaze_drive(hall, "active", SEED, None, recorder, settings.egomotion)
    mapped = result, recorder.snapshots
    return {"drive": write_results(drive, settings, output, _report_nothing, *mapped, builder)}


def _report_nothing(done: int, total: int | None = None, stage: str = "") -> None:
    """Ignores the progress of one example; the terminal shows how many are done."""


EXAMPLES = (_look_and_match, _map_a_log, _map_a_drive)
"""The examples in the order of the report; the first two compile different kernels."""
