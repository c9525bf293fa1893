"""`saccade drive`: visual SLAM from camera frames and odometry."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from typer import Option

from saccade.cli.options import (
    MAX_CAMERA_FRAMES,
    Baseline,
    Camera,
    CheckpointInterval,
    Config,
    FigureFormats,
    Film,
    Intrinsics,
    Json,
    LivePage,
    LiveWindow,
    Out,
    Preset,
    SequenceFormat,
    SequencePath,
    figure_formats,
)

if TYPE_CHECKING:
    from saccade import datasets


def drive(
    sequence: SequencePath,
    out: Out = Path("saccade-drive"),
    kind: SequenceFormat = None,
    frames: Annotated[
        int | None, Option(min=1, metavar="N", help="Process only the first N frames.")
    ] = None,
    detector: Annotated[
        str | None, Option(help="Keypoint detector of the landmarks: sift, must or symroid.")
    ] = None,
    selection: Annotated[
        str | None,
        Option(
            help="Landmark selection criterion: strength, random, range, contrast, symmetry, "
            "rematch-rate, rematch-rate-range or rematch-rate-spread."
        ),
    ] = None,
    max_landmarks: Annotated[
        int | None, Option(min=1, help="Maximum number of landmarks in the map.")
    ] = None,
    intrinsics: Intrinsics = None,
    baseline: Baseline = None,
    anyway: Annotated[
        bool, Option("--anyway", help="Use frames that repeat the frame before as they are.")
    ] = False,
    save_tracks: Annotated[
        Path | None,
        Option(metavar="FOLDER", help="Also write the tracked points, as a drive of tracks."),
    ] = None,
    camera: Camera = None,
    live: LiveWindow = False,
    page: LivePage = False,
    figures: FigureFormats = None,
    film: Film = True,
    checkpoint: CheckpointInterval = 10.0,
    preset: Preset = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Map a camera drive: visual odometry, keypoint landmarks and EKF-SLAM.

    --out receives the trajectory (trajectory.tum, for evo; poses.csv with
    covariances), the map (landmarks.csv; map.npz with descriptors), every
    observation of a landmark (observations.csv), a figure (map.png), a film
    (drive.mp4) and a frame of it (drive.png), an interactive report
    (report.html), and settings and scores (run.json).

    An interrupted run resumes from its last checkpoint.

    With --camera a camera is mapped live, and recorded in the folder SEQUENCE, whose camera.toml is
    its calibration; Ctrl-C ends the drive.
    """
    from dataclasses import replace

    from saccade import datasets
    from saccade.cli.drive_run import map_drive
    from saccade.cli.output import print_message, progress_bar
    from saccade.cli.run_output import RunOutput
    from saccade.datasets.drives.bare import CameraOptions, parse_intrinsics
    from saccade.diagnostics import drop_repeated
    from saccade.io.files import results_in
    from saccade.settings import load_settings

    settings = load_settings("visual", preset, config)
    given = {"detector": detector, "selection": selection, "max_landmarks": max_landmarks}
    settings = replace(settings, **{k: v for k, v in given.items() if v is not None})
    known_camera = CameraOptions(parse_intrinsics(intrinsics), baseline)
    output = RunOutput(out, film, checkpoint_interval=checkpoint, figures=figure_formats(figures))
    if camera is not None:
        from saccade.cli.live_run import Live, map_camera

        source = Live(camera, frames or MAX_CAMERA_FRAMES, live, page)
        with results_in(out), progress_bar(f"camera {camera}") as progress:
            row = map_camera(source, sequence, known_camera, settings, output, progress)
        print_drive(row, as_json, f"camera {camera} -> {out}")
        return
    kind = "auto" if kind is None else kind
    recorded = datasets.load_drive(cast("datasets.DriveKind", kind), sequence, known_camera)
    if frames is not None:
        recorded = recorded.until(frames)
    if not anyway:
        recorded = drop_repeated(recorded)
    known = (*recorded.remarks, *recorded.assumptions)
    for remark in known:
        print_message(remark)
    with results_in(out), progress_bar(recorded.name) as progress:
        row = map_drive(recorded, settings, output, progress, save_tracks)
    print_drive(row, as_json, f"{recorded.name} -> {out}", len(known))


def print_drive(row: dict[str, Any], as_json: bool, title: str, said: int = 0) -> None:
    """Print the remarks of a drive after those that were said before, and its figures."""
    from saccade.cli.output import print_json, print_message

    for remark in row["remarks"][said:]:
        print_message(remark)
    if as_json:
        print_json(row)
    else:
        print_summary(row, title)


def print_summary(row: dict[str, Any], title: str) -> None:
    """Print the figures of a drive as tables."""
    from saccade.cli.output import print_table
    from saccade.cli.slam_report import lost_text

    if row["ate_m"] is not None:
        trajectories = {"SLAM": row, "odometry": row["odometry"]}
        trajectories["visual odometry"] = row["visual_odometry"]
        columns = {
            "ate_m": "ATE (m)",
            "ate_unaligned_m": "unaligned (m)",
            "rpe_m": "RPE (m)",
            "end_m": "at the end (m)",
            "inside_3sigma": "in 99.7 % ellipse",
        }
        print_table(
            title,
            ["", *columns.values()],
            [
                [name, *("" if (v := errors.get(c)) is None else f"{v:.3f}" for c in columns)]
                for name, errors in trajectories.items()
            ],
        )
    facts = {
        "frames": str(row["frames"]),
        "landmarks": str(row["landmarks"]),
        "observations": str(row["observations"]),
        "re-identifications": str(row["reidentified"]),
        "ms per frame": f"{row['ms_per_frame']:.1f}",
        **{f"  {step}": f"{value:.1f}" for step, value in row["ms"].items()},
    }
    if row["lost"]:
        facts["lost"] = lost_text(row["lost"])
    if row["association_precision"] is not None:
        facts["association precision"] = f"{row['association_precision']:.1%}"
    print_table("" if row["ate_m"] is not None else title, ["", ""], facts.items())
