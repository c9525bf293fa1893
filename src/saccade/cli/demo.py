"""`saccade demo`: attention, matching and SLAM on data that ships with the package."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from saccade.cli.options import Json

if TYPE_CHECKING:
    from saccade.viewing.report import ReportBuilder

LEAD = (
    "An image goes in, attention says where to look, interest points say what to keep, "
    "landmarks say where things are, and a map comes out."
)
SEED, FRAMES = 0, 160
"""Seed and number of frames of the simulated drive."""


def demo(
    out: Annotated[Path, Option("--out", "-o", help="Output folder.")] = Path("saccade-demo"),
    as_json: Json = False,
) -> None:
    """Run look, match, slam and drive on built-in data, and write index.html.

    Everything needed ships with the package. The first run also compiles, for
    up to a minute.
    """
    from importlib.resources import as_file, files

    from saccade.cli.output import print_json, print_message, print_table, write_text
    from saccade.io.files import results_in
    from saccade.viewing.report import ReportBuilder

    builder = ReportBuilder("saccade demo", LEAD)
    page = out / "index.html"
    with results_in(out):
        with as_file(files("saccade") / "data") as data:
            results = _run(data, out, builder)
        report = builder.write(out / "report.html")
        write_text(page, _page(results))
    if as_json:
        print_json({"page": str(page), "report": str(report), **results})
        return
    look, match, slam, drive = results.values()
    print_table(
        "saccade demo",
        ["file", "content"],
        [
            [look["picture"], f"{len(look['scanpath'])} fixations"],
            [match["picture"], f"{match['matches']} matches"],
            [slam["files"]["picture"], f"{slam['landmarks']} landmarks by laser"],
            [drive["files"]["film"], f"{drive['landmarks']} landmarks by camera"],
            [str(report), "all results, interactive"],
            [str(page), "all results"],
        ],
    )
    print_message(f"open {page} in a browser; then try: saccade look YOUR_PHOTO.jpg")


def _run(data: Path, out: Path, builder: "ReportBuilder") -> dict[str, dict[str, Any]]:
    """Run the four commands with progress bars; returns the row of each."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from saccade import datasets
    from saccade.cli.attention_models import DEFAULT_MODEL, attention_model
    from saccade.cli.drive_run import write_results
    from saccade.cli.look_run import analyze_image
    from saccade.cli.match_run import match_images
    from saccade.cli.precompile import filter_compiled_ahead
    from saccade.cli.run_output import RunOutput
    from saccade.cli.slam_run import map_log
    from saccade.evaluation.gaze_drives import SETTINGS, gaze_drive
    from saccade.keypoints.sift import Sift
    from saccade.settings import load_settings
    from saccade.simulation import DriveConfig
    from saccade.slam import Recorder

    columns = (TextColumn("{task.description:<40}"), BarColumn(), TimeElapsedColumn())
    victoria_park = data / "victoria_park.txt"
    results: dict[str, dict[str, Any]] = {}
    with (
        filter_compiled_ahead(also="points") as finish,
        Progress(*columns, console=Console(stderr=True)) as bar,
    ):
        task = bar.add_task("attention: saliency and scanpath", total=1)
        attention = attention_model(DEFAULT_MODEL, preset=None, config=None, free_viewing=True)
        results["look"] = analyze_image(data / "chelsea.jpg", out / "look", attention, 10, builder)
        bar.update(task, completed=1)

        task = bar.add_task("interest points: two views of a hallway", total=1)
        pair = (data / "hallway_1.jpg", data / "hallway_2.jpg")
        results["match"] = match_images(*pair, out, Sift(load_settings("sift")), builder)
        bar.update(task, completed=1)

        def progress(done: int, total: int | None = None, stage: str = "") -> None:
            bar.update(task, completed=done, total=total)

        task = bar.add_task("EKF-SLAM: a car in Victoria Park", total=None)
        log = datasets.load("victoria-park", victoria_park)
        finish()
        output = RunOutput(out, film=False, report=builder)
        results["slam"] = map_log(log, load_settings("slam"), output, progress)

        task = bar.add_task("visual SLAM: a robot that looks around", total=None)
        rooms = DriveConfig(
            world="rooms",
            frames=FRAMES,
            frames_per_lap=FRAMES,
            image_size=(240, 180),
            field_of_view=50.0,
            color=True,
        )
        recorder = Recorder(FRAMES // 2)
        drive, result = gaze_drive(rooms, "active", SEED, progress, recorder)
        output = RunOutput(out / "drive", report=builder)
        snapshots = recorder.snapshots
        results["drive"] = write_results(drive, SETTINGS, output, progress, result, snapshots)
    return results


def _page(results: dict[str, dict[str, Any]]) -> str:
    from saccade.cli.slam_report import facts
    from saccade.viewing import Picture, Section, html_page

    look, match, slam, drive = results.values()
    sections = [
        Section(
            "Interactive report",
            "The same four results on one page: layers to switch, maps to play through time, "
            "landmarks and points to click.",
            links=["report.html"],
        ),
        Section(
            "Attention: where to look",
            "The contrast model finds locations that differ from their surroundings in intensity, "
            "color or orientation, the symmetry model finds centers of facing edges, and Boolean "
            "maps find surrounded regions. The scanpath is the most probable one of a model that "
            "was fitted to people.",
            [
                Picture(
                    Path(look["picture"]).name,
                    "The photograph with numbered fixations, the maps of saliency, contrast and "
                    "symmetry as heat, and the pairs of edges that drew the fixations",
                    "Chelsea the cat: scanpath, saliency, the maps that it combines, and the "
                    "symmetric edge pairs at the fixations. Photograph: Stefan van der Walt, CC0.",
                    wide=True,
                )
            ],
            links=[Path(look["arrays"]).name],
        ),
        Section(
            "Interest points: what to keep",
            "SIFT detects points that can be found again from another viewpoint. Two laps through "
            "the same hallway, matched by nearest neighbors with ratio test and mutual check.",
            [
                Picture(
                    Path(match["picture"]).name,
                    "Two photographs of one hallway, joined by lines between matched points",
                    f"{match['matches']} matches between {match['first_points']} and "
                    f"{match['second_points']} interest points. "
                    "Photographs: RTAB-Map samples, BSD-3.",
                )
            ],
            links=[Path(match["table"]).name],
        ),
        Section(
            "EKF-SLAM: where things are",
            "A car drives through a park and detects trees with its laser. The filter estimates "
            "the trajectory and the trees, with their covariances.",
            [
                Picture(
                    Path(slam["files"]["picture"]).name,
                    "The estimated trajectory, the trajectory from odometry alone, and the "
                    "landmarks with their ellipses",
                    "Victoria Park, Sydney. Log: J. Guivant and E. Nebot, as distributed with "
                    "GTSAM, BSD.",
                )
            ],
            facts=facts(slam),
            links=[*(Path(path).name for path in slam["files"].values()), "run.json"],
        ),
        Section(
            "Visual SLAM: a robot that decides where to look",
            "A robot drives through two simulated rooms. It keeps interest points of its stereo "
            "camera as landmarks, and turns the camera to where it expects to learn most about its "
            "pose and the map: at landmarks that it knows, or where it has none yet.",
            [
                Picture(
                    f"drive/{Path(drive['files']['still']).name}",
                    "The camera image with landmarks, the same image with saliency as heat, and "
                    "the map with the trajectory",
                    "A frame of the film. The posters are photographs of scikit-image's data, CC0 "
                    "and public domain.",
                    wide=True,
                )
            ],
            facts={
                "ATE": f"{drive['ate_m']:.3f} m",
                "ATE of odometry": f"{drive['odometry']['ate_m']:.3f} m",
                "landmarks": str(drive["landmarks"]),
            },
            links=[f"drive/{Path(path).name}" for path in drive["files"].values()],
        ),
    ]
    return html_page("saccade demo", LEAD, sections)
