"""`saccade demo`: attention, matching and SLAM on data that ships with the package."""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from saccade import datasets
from saccade.cli.drive import write_results
from saccade.cli.look import LookOptions, analyze_image
from saccade.cli.mapping import RunOutput
from saccade.cli.match import MatchOptions, match_images
from saccade.cli.options import JsonOptions, OutputFolder
from saccade.cli.output import Result, Table, print_message, progress_bar, write_text
from saccade.cli.slam import SlamOptions, map_log
from saccade.io.files import results_in
from saccade.io.image import read_image
from saccade.keypoints.sift import Sift
from saccade.simulation import DriveConfig
from saccade.simulation.gaze_drive import SETTINGS, gaze_drive
from saccade.slam import Recorder
from saccade.viewing import Picture, Section, attention_figure, overview_page, save_figure
from saccade.viewing.report import ReportBuilder

LEAD = (
    "An image goes in, attention says where to look, interest points say what to keep, "
    "landmarks say where things are, and a map comes out."
)
SEED, FRAMES = 0, 80
"""Seed and number of frames of the simulated drive."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions(JsonOptions):
    """Options of `saccade demo`."""

    out: OutputFolder = Path("saccade-demo")


def demo(options: DemoOptions = DemoOptions()) -> Result:
    """Run look, match, slam and drive on built-in data, and write index.html.

    Everything needed ships with the package. The first run also compiles, for
    up to a minute.

    Example: saccade demo --out saccade-demo
    """
    out = options.out
    builder = ReportBuilder("saccade demo", LEAD)
    page = out / "index.html"
    with results_in(out), as_file(files("saccade") / "data") as data:
        results = {
            "look": _look(data, out, builder),
            "match": _match(data, out, builder),
            "slam": _slam(data, out, builder),
            "drive": _drive(out, builder),
        }
        report = builder.write(out / "report.html")
        write_text(page, _page(out, *results.values()))
    look, match, slam, drive = results.values()
    print_message(f"open {page} in a browser; then try: saccade look YOUR_PHOTO.jpg")
    rows = [
        [look["picture"], f"{len(look['scanpath'])} fixations"],
        [match["picture"], f"{match['matches']} matches"],
        [slam["files"]["picture"], f"{slam['landmarks']} landmarks by laser"],
        [drive["files"]["film"], f"{drive['landmarks']} landmarks by camera"],
        [str(report), "all results, interactive"],
        [str(page), "all results"],
    ]
    row = {"page": str(page), "report": str(report), **results}
    return Result(row, [Table("saccade demo", ["file", "content"], rows)])


def _look(data: Path, out: Path, builder: ReportBuilder) -> dict[str, Any]:
    """Saliency and scanpath of a photograph."""
    photo = data / "chelsea.jpg"
    with progress_bar("attention: saliency and scanpath"):
        options = LookOptions(keypoints=True)
        attention = options.attention_model(options.model, free_viewing=True)
        row, (path, _) = analyze_image(photo, out / "look", attention, options, builder)
        save_figure(attention_figure(read_image(photo), {}, path), out / "scanpath.png")
    return row


def _match(data: Path, out: Path, builder: ReportBuilder) -> dict[str, Any]:
    """Interest points of two views."""
    first, second = (data / f"hallway_{number}.jpg" for number in (1, 2))
    with progress_bar("interest points: two views of a hallway"):
        matching = MatchOptions(first=str(first), second=second, out=out)
        return match_images(Sift(), matching, second, builder)


def _slam(data: Path, out: Path, builder: ReportBuilder) -> dict[str, Any]:
    """Map of a recorded log."""
    with progress_bar("EKF-SLAM: a car in Victoria Park") as progress:
        log = datasets.load("victoria-park", data / "victoria_park.txt")
        return map_log(log, SlamOptions(out=out), progress, builder)


def _drive(out: Path, builder: ReportBuilder) -> dict[str, Any]:
    """Map of a simulated drive."""
    rooms = DriveConfig(
        world="rooms",
        frames=FRAMES,
        frames_per_lap=FRAMES,
        image_size=(240, 180),
        field_of_view_deg=50.0,
        color=True,
    )
    recorder = Recorder(FRAMES // 2)
    output = RunOutput(out=out / "drive", film=True)
    with progress_bar("visual SLAM: a robot that looks around") as progress:
        drive, result = gaze_drive(rooms, "active", SEED, progress, recorder)
        return write_results(
            *(drive, SETTINGS, output, progress, result, recorder.snapshots, builder)
        )


def _page(
    out: Path,
    look: dict[str, Any],
    match: dict[str, Any],
    slam: dict[str, Any],
    drive: dict[str, Any],
) -> str:
    """A picture of each result with its legend, and links to the files."""

    def section(
        heading: str, text: str, picture: str | Path, shown: str, legend: str, others: Iterable[str]
    ) -> Section:
        source, *links = (Path(each).relative_to(out).as_posix() for each in (picture, *others))
        return Section(heading, text, [Picture(source, shown, legend)], links=links)

    sections = [
        section(
            "Where to look",
            "A model that was fitted to people predicts which places of a photograph they look "
            "at, and in which order.",
            out / "scanpath.png",
            "A photograph of a cat with numbered fixations that are joined by lines",
            "Numbers: the order of the fixations, the first in white. "
            "Photograph: Stefan van der Walt, CC0.",
            [look["picture"], look["arrays"]],
        ),
        section(
            "What to keep",
            f"Interest points are found again from another place: {match['matches']} of "
            f"{match['first_points']} on a second lap through the hallway.",
            match["picture"],
            "Two photographs of one hallway, joined by lines between matched points",
            "Green: matches that agree with one motion of the camera; red: the others. "
            "Photographs: RTAB-Map samples, BSD-3.",
            [match["table"]],
        ),
        section(
            "Where things are",
            f"A car drives through a park, and EKF-SLAM finds its way and {slam['landmarks']} "
            "trees from odometry and a laser.",
            slam["files"]["picture"],
            "The estimated trajectory, that from odometry alone, and landmarks with ellipses",
            "Blue: the way; dashed: from odometry alone; orange: 3 sigma of each tree. Victoria "
            "Park, Sydney; log: J. Guivant and E. Nebot, as distributed with GTSAM, BSD.",
            slam["files"].values(),
        ),
        section(
            "Where to look next",
            "A robot turns its camera to where it expects to learn most about its pose and the "
            f"map: its position is off by {drive['ate_m']:.2f} m on average, by "
            f"{drive['odometry']['ate_m']:.2f} m from its wheels alone.",
            drive["files"]["still"],
            "The camera image with landmarks, its saliency as heat, and the map",
            "A frame of the film. Blue: the way; dashed: from odometry alone; orange: 3 sigma of "
            "each landmark; green: what is in view. Posters: photographs of scikit-image's data, "
            "CC0 and public domain.",
            drive["files"].values(),
        ),
    ]
    links = {"report.html": "Explore all four results"}
    return overview_page("saccade demo", LEAD, sections, links)
