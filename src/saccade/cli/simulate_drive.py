"""`saccade simulate drive`: a camera drive with ground truth."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from typer import Option

from saccade.cli.options import Config, EgomotionName, Json, Out, Seed

if TYPE_CHECKING:
    from saccade.visual.config import EgomotionSource


def drive(
    out: Out = Path("saccade-simulated-drive"),
    seed: Seed = 0,
    preset: Annotated[
        str | None,
        Option(
            "--preset", "-p", help="ring, mono, repeated, mirror, dark, flicker, crossing or rooms."
        ),
    ] = None,
    frames: Annotated[
        int | None, Option(min=2, help="Number of frames; a lap has 300, a drive two laps.")
    ] = None,
    gaze: Annotated[
        str | None,
        Option(help="Turn the camera while it maps: fixed, sweep, random, salient or active."),
    ] = None,
    egomotion: EgomotionName = "camera",
    color: Annotated[bool, Option("--color", help="Render in color.")] = False,
    depth: Annotated[bool, Option("--depth", help="Also render depth images.")] = False,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Simulate the drive of a robot with a camera around a courtyard with posters.

    --out receives the images of the left (image_0) and right camera (image_1),
    the calibration (calib.txt, camera.toml), times.txt, odometry with its
    covariance (odometry.csv) and the true trajectory (groundtruth.tum); with
    --gaze also how the camera was turned (gaze.csv); in the
    layout of KITTI's odometry benchmark, for saccade drive. The seed
    determines the noise, the walls and the posters.
    """
    from saccade.cli.output import print_result, progress_bar
    from saccade.datasets import save_drive
    from saccade.settings import load_settings
    from saccade.simulation import simulate_drive

    settings = load_settings("drive", preset, config)
    if frames is not None:
        settings = replace(settings, frames=frames)
    settings = replace(settings, color=settings.color or color, depth=settings.depth or depth)
    if gaze is None:
        simulated = simulate_drive(settings, seed)
    else:
        from saccade.errors import require
        from saccade.evaluation.gaze_drives import gaze_drive
        from saccade.gaze import POLICIES

        require(gaze in POLICIES, "gaze", f"one of {', '.join(POLICIES)}", gaze)
        with progress_bar("looking", settings.frames) as update:
            simulated, _ = gaze_drive(
                settings, gaze, seed, update, egomotion=cast("EgomotionSource", egomotion)
            )
    with progress_bar("rendering", len(simulated)) as update:
        save_drive(out, simulated, update)
    row = {
        "sequence": str(out),
        "frames": len(simulated),
        "cameras": 2 if simulated.camera.baseline > 0 else 1,
        "truth": repr(simulated.truth),
    }
    print_result(row, as_json, f"{simulated.name} -> {out}")
