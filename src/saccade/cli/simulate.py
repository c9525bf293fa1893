"""`saccade simulate`: a landmark log or a camera drive with ground truth."""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, cast

from typer import Argument, Option

from saccade import datasets
from saccade.cli.options import Config, EgomotionName, Json, Seed, folder_name
from saccade.cli.output import emit_facts, progress_bar
from saccade.errors import ConfigError, require
from saccade.evaluation.gaze import gaze_drive
from saccade.gaze import POLICIES
from saccade.io.files import results_in
from saccade.settings import load_settings
from saccade.simulation import simulate_drive, simulate_world
from saccade.visual.config import EgomotionSource


class World(StrEnum):
    """What is simulated."""

    WORLD = "world"
    DRIVE = "drive"


def simulate(
    kind: Annotated[
        World,
        Argument(
            metavar="world|drive",
            help="world: the landmark log of a robot or a car. drive: the drive of a robot with a "
            "camera around a courtyard with posters.",
        ),
    ],
    out: Annotated[
        Path | None,
        Option(
            "--out",
            "-o",
            help="Output folder.",
            callback=folder_name,
            show_default="saccade-world or saccade-simulated-drive",
        ),
    ] = None,
    seed: Seed = 0,
    preset: Annotated[
        str | None,
        Option(
            "--preset",
            "-p",
            help="Of a world loop, slippery, coarse or car; of a drive ring, mono, repeated, "
            "mirror, dark, flicker, crossing or rooms.",
        ),
    ] = None,
    frames: Annotated[
        int | None,
        Option(min=2, help="Frames of a drive; a lap has 300, and there are two laps."),
    ] = None,
    gaze: Annotated[
        str | None,
        Option(
            help="Turn the camera of a drive while it maps: fixed, sweep, random, salient or "
            "active."
        ),
    ] = None,
    egomotion: EgomotionName = "camera",
    color: Annotated[bool, Option("--color", help="Render a drive in color.")] = False,
    depth: Annotated[bool, Option("--depth", help="Also render depth images.")] = False,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Simulate a landmark log or a camera drive, with ground truth.

    Of a world --out receives the log (log.csv, for saccade slam), the true
    trajectory (truth.tum) and the true landmarks (landmarks.csv). The seed
    determines the noise, but not the landmarks.

    Of a drive --out receives the images of the left (image_0) and right camera
    (image_1), the calibration (calib.txt, camera.toml), times.txt, odometry
    with its covariance (odometry.csv) and the true trajectory
    (groundtruth.tum); with --gaze also how the camera was turned (gaze.csv);
    in the layout of KITTI's odometry benchmark, for saccade drive. The seed
    determines the noise, the walls and the posters.
    """
    settings = load_settings(kind.value, preset, config)
    if kind is World.WORLD:
        if frames or gaze or color or depth:
            raise ConfigError("--frames, --gaze, --color, --depth: expected a drive, found world")
        _simulate_world(out or Path("saccade-world"), settings, seed, as_json)
        return
    if frames is not None:
        settings = replace(settings, frames=frames)
    settings = replace(settings, color=settings.color or color, depth=settings.depth or depth)
    if gaze is None:
        simulated = simulate_drive(settings, seed)
    else:
        require(gaze in POLICIES, "gaze", f"one of {', '.join(POLICIES)}", gaze)
        with progress_bar("looking", settings.frames) as update:
            simulated, _ = gaze_drive(
                settings, gaze, seed, update, egomotion=cast("EgomotionSource", egomotion)
            )
    out = out or Path("saccade-simulated-drive")
    with progress_bar("rendering", len(simulated)) as update:
        datasets.save_drive(out, simulated, update)
    row = {
        "sequence": str(out),
        "frames": len(simulated),
        "cameras": 2 if simulated.camera.baseline > 0 else 1,
        "truth": repr(simulated.truth),
    }
    emit_facts(row, as_json, f"{simulated.name} -> {out}")


def _simulate_world(out: Path, settings: Any, seed: int, as_json: bool) -> None:
    log = simulate_world(settings, seed)
    assert log.truth is not None
    assert log.landmark_truth is not None
    with results_in(out):
        datasets.save(out / "log.csv", log)
        datasets.write_tum(out / "truth.tum", log.truth)
        datasets.write_landmarks(out / "landmarks.csv", log.landmark_truth)
    row = {
        "log": str(out / "log.csv"),
        "poses": len(log.time),
        "observations": len(log.observation),
        "landmarks": len(log.landmark_truth),
    }
    emit_facts(row, as_json, f"{log.name} -> {out}")
