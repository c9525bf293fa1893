"""`saccade demo`: attention, matching and SLAM on data that ships with the package."""

import sys
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import TYPE_CHECKING, Any

from saccade.cli.options import JsonOptions, OutputFolder
from saccade.cli.output import Result, Table, print_message, progress_bar
from saccade.io.files import results_in

if TYPE_CHECKING:
    from saccade.viewing.report import ReportBuilder

LEAD = (
    "Attention selects where to look in an image, interest points select what to keep, the "
    "filter turns them into landmarks, and the result is a map. Photograph of a cat: Stefan van "
    "der Walt, CC0; of a hallway: RTAB-Map samples, BSD-3. Log of Victoria Park, Sydney: J. "
    "Guivant and E. Nebot, as distributed with GTSAM, BSD. The last drive is simulated: a robot "
    "points its camera where it expects the most information about its pose and the map."
)
COMPILE_AHEAD = "from saccade.cli.demo import compile_ahead; compile_ahead()"
"""Program of the process that compiles the later kernels while the first parts run."""
SEED = 0
"""Seed of the simulated drive."""
FRAMES = 80
"""Number of frames of the simulated drive."""
FRAMES_PER_LAP = 56
"""Number of frames of one of its laps."""


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
    from saccade.cli.look import LookOptions
    from saccade.cli.look_image import analyze_image
    from saccade.cli.match import MatchOptions, match_images
    from saccade.cli.slam_options import SlamOptions
    from saccade.cli.slam_run import map_log
    from saccade.keypoints import Sift
    from saccade.viewing.report import ReportBuilder

    out = options.out
    builder = ReportBuilder("saccade demo", LEAD)
    command = [sys.executable, "-c", COMPILE_AHEAD]
    with (
        results_in(out),
        as_file(files("saccade") / "data") as data,
        Popen(command, stdout=DEVNULL, stderr=DEVNULL) as ahead,
    ):
        with progress_bar("attention: saliency and scanpath"):
            photo = data / "chelsea.jpg"
            looking = LookOptions(keypoints=True, out=out)
            attention = looking.attention_model(looking.model, free_viewing=True)
            look, _ = analyze_image(photo, photo.stem, attention, looking, builder)
        with progress_bar("interest points: two views of a hallway"):
            hallway = data / "hallway_1.jpg", data / "hallway_2.jpg"
            match = match_images(Sift(), hallway, MatchOptions(out=out), builder)
        ahead.wait()
        with progress_bar("EKF-SLAM: a car in Victoria Park") as progress:
            mapping = SlamOptions(out=out)
            log = mapping.load(data / "victoria_park.txt")
            slam = map_log(log, mapping, progress, builder)
        drive = _drive(out, builder)
        page = builder.write(out / "index.html")
    print_message(f"open {page} in a browser; then try: saccade look YOUR_PHOTO.jpg")
    rows = [
        [look["picture"], f"{len(look['scanpath'])} fixations"],
        [match["picture"], f"{match['matches']} matches"],
        [slam["files"]["picture"], f"{slam['landmarks']} landmarks by laser"],
        [drive["files"]["film"], f"{drive['landmarks']} landmarks by camera"],
        [str(page), "all results, interactive"],
    ]
    row = {"page": str(page), "look": look, "match": match, "slam": slam, "drive": drive}
    return Result(row, [Table("saccade demo", ["file", "content"], rows)])


def compile_ahead() -> None:
    """Compiles the kernels of two-view geometry and of the filter, into the cache on disk."""
    import numpy as np

    from saccade.keypoints import verify
    from saccade.simulation import WorldConfig, simulate_world
    from saccade.slam import run
    from saccade.types import Keypoints

    points = np.random.default_rng(SEED).uniform((-1, -1, 3), (1, 1, 5), (60, 3))
    views = points, np.add(points, (0.3, 0, 0.1))
    first, second = (Keypoints.at(300 * xyz[:, :2] / xyz[:, 2:], 1.0) for xyz in views)
    verify(first, second, np.arange(len(points))[:, None].repeat(2, 1))
    run(simulate_world(WorldConfig(steps=60)))


def _drive(out: Path, builder: "ReportBuilder") -> dict[str, Any]:
    """Map of a simulated drive through a hall with few posters."""
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
    with progress_bar("visual SLAM: a robot that looks around") as progress:
        drive, result = gaze_drive(hall, "active", SEED, progress, recorder, settings.egomotion)
        return write_results(
            *(drive, settings, output, progress, result, recorder.snapshots, builder)
        )
