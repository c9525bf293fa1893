"""`saccade demo`: look, match, map and drive on what ships with the package."""

from pathlib import Path
from typing import Annotated, Any

import typer

from saccade.cli.options import Json
from saccade.cli.report_builder import ReportBuilder

LEAD = (
    "An image goes in, attention says where to look, interest points say what to keep, "
    "landmarks say where things are, and a map comes out."
)
SEED, FRAMES = 0, 200
"""Of the simulated drive."""


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for what is made.")] = Path(
        "saccade-demo"
    ),
    as_json: Json = False,
) -> None:
    """Look, match, map a park, and drive a robot by its camera; then open index.html.

    Everything it needs ships with the package. The first run compiles and
    takes up to a minute, the next ones take seconds.
    """
    from importlib.resources import as_file, files

    from saccade.cli.output import print_json, print_message, print_table, write_text
    from saccade.files import make_folder

    make_folder(out)
    builder = ReportBuilder("saccade demo", LEAD)
    with as_file(files("saccade") / "data") as data:
        made = _make(data, out, builder)
    looked, matched, mapped, driven = made.values()
    report = builder.write(out / "report.html")
    page = out / "index.html"
    write_text(page, _page(looked, matched, mapped, driven))
    if as_json:
        print_json({"page": str(page), "report": str(report), **made})
        return
    print_table(
        "saccade demo",
        ["made", "what"],
        [
            [looked["picture"], f"{len(looked['scanpath'])} fixations"],
            [matched["picture"], f"{matched['matches']} matches"],
            [mapped["files"]["picture"], f"{mapped['landmarks']} landmarks"],
            [driven["files"]["film"], f"{driven['landmarks']} landmarks by camera"],
            [str(report), "to switch, scrub and click"],
            [str(page), "all of it"],
        ],
    )
    print_message(f"open {page} in a browser; then try: saccade look YOUR_PHOTO.jpg")


def _make(data: Path, out: Path, builder: ReportBuilder) -> dict[str, dict[str, Any]]:
    """The three systems and the whole, with a progress bar where someone watches."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from saccade import datasets
    from saccade.cli.attention_models import Model, attention_model
    from saccade.cli.drive import map_drive
    from saccade.cli.look import look_at
    from saccade.cli.match import match_images
    from saccade.cli.precompile import filter_compiled_ahead
    from saccade.cli.slam import map_log
    from saccade.keypoints.sift import Sift
    from saccade.settings import load_settings
    from saccade.simulation import DriveConfig, simulate_drive

    columns = (TextColumn("{task.description:<44}"), BarColumn(), TimeElapsedColumn())
    victoria_park = data / "victoria_park.txt"
    with (
        filter_compiled_ahead(victoria_park) as wait,
        Progress(*columns, console=Console(stderr=True)) as progress,
    ):
        looking = progress.add_task("attention: where to look in a photograph", total=1)
        attention = attention_model(Model.both, preset=None, config=None)
        looked = look_at(
            data / "rocket.jpg", out / "look", attention, fixations=10, builder=builder
        )
        progress.update(looking, completed=1)

        matching = progress.add_task("interest points: what two photographs share", total=1)
        pair = (data / "hallway_1.jpg", data / "hallway_2.jpg")
        sift = Sift(load_settings("sift"))
        matched = match_images(*pair, out, sift, ratio=0.8, mutual=True, builder=builder)
        progress.update(matching, completed=1)

        mapping = progress.add_task("EKF-SLAM: a car in Victoria Park", total=None)
        log = datasets.load("victoria-park", victoria_park)
        wait()
        mapped = map_log(
            log,
            out,
            load_settings("slam"),
            lambda _, done, total: progress.update(mapping, completed=done, total=total),
            film=False,
            builder=builder,
        )

        driving = progress.add_task("all of it: a robot finds its way by its camera", total=None)
        driven = map_drive(
            simulate_drive(DriveConfig(frames=FRAMES, frames_per_lap=FRAMES // 2), SEED),
            out / "drive",
            load_settings("visual"),
            lambda _, done, total: progress.update(driving, completed=done, total=total),
            pictures=FRAMES // 4,
            builder=builder,
        )
    return {"look": looked, "match": matched, "slam": mapped, "drive": driven}


def _page(
    looked: dict[str, Any],
    matched: dict[str, Any],
    mapped: dict[str, Any],
    driven: dict[str, Any],
) -> str:
    from saccade.cli.slam_report import facts
    from saccade.viewing import Picture, Section, html_page

    sections = [
        Section(
            "All of it, to switch, scrub and click",
            "The same four results on one page: layers to switch, maps to play through time, "
            "landmarks and points to click.",
            links=["report.html"],
        ),
        Section(
            "Attention: where to look",
            "The contrast model looks for places that differ from their surroundings in intensity, "
            "color or orientation, the symmetry model for edges that face each other across a "
            "place. A winner-take-all network then visits the most salient places one by one.",
            [
                Picture(
                    Path(looked["picture"]).name,
                    "The photograph with numbered fixations, the maps of saliency, contrast and "
                    "symmetry as heat, and the pairs of edges that drew the fixations",
                    "Rocket on the pad at dusk: scanpath, saliency, the maps that it is made of, "
                    "and what is symmetric about the fixations. Photograph: SpaceX, CC0.",
                    wide=True,
                )
            ],
            links=[Path(looked["arrays"]).name],
        ),
        Section(
            "Interest points: what to keep",
            "SIFT finds places that can be found again from elsewhere. Two laps through the same "
            "hallway, matched by nearest neighbors with ratio test and mutual check.",
            [
                Picture(
                    Path(matched["picture"]).name,
                    "Two photographs of one hallway, joined by lines between matched points",
                    f"{matched['matches']} matches between {matched['first_points']} and "
                    f"{matched['second_points']} interest points. "
                    "Photographs: RTAB-Map samples, BSD-3.",
                )
            ],
            links=[Path(matched["table"]).name],
        ),
        Section(
            "EKF-SLAM: where things are",
            "A car drives through a park and sees trees with its laser. The filter estimates both "
            "the drive and the trees, and says how sure it is of each.",
            [
                Picture(
                    Path(mapped["files"]["picture"]).name,
                    "The estimated drive, the drive from odometry alone, and the landmarks with "
                    "their ellipses",
                    "Victoria Park, Sydney. Log: J. Guivant and E. Nebot, as distributed with "
                    "GTSAM, BSD.",
                )
            ],
            facts=facts(mapped),
            links=[*(Path(path).name for path in mapped["files"].values()), "run.json"],
        ),
        Section(
            "All of it: a robot finds its way by its camera",
            "A robot drives two laps round a courtyard that exists only in the computer. Of what "
            "its stereo camera sees it keeps interest points as landmarks, follows them from frame "
            "to frame, and knows them again on the second lap.",
            [
                Picture(
                    f"drive/{Path(driven['files']['still']).name}",
                    "The camera's picture with landmarks, the same picture with attention as heat, "
                    "and the map with the drive",
                    "A frame of the film. The posters are photographs of scikit-image's data, CC0 "
                    "and public domain.",
                    wide=True,
                )
            ],
            facts={
                "error of the drive (ATE)": f"{driven['ate_m']:.3f} m",
                "of odometry alone": f"{driven['odometry']['ate_m']:.3f} m",
                "landmarks": str(driven["landmarks"]),
            },
            links=[f"drive/{Path(path).name}" for path in driven["files"].values()],
        ),
    ]
    return html_page("saccade demo", LEAD, sections)
