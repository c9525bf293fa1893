"""`saccade simulate`: a landmark log or a camera drive with ground truth."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from cyclopts import Parameter

from saccade import datasets
from saccade.cli.options import (
    INPUT,
    OUT,
    OUTPUT,
    Egomotion,
    JsonOptions,
    SettingsOptions,
)
from saccade.cli.output import Result, facts_table, progress_bar
from saccade.errors import ConfigError, setting
from saccade.gaze import POLICIES
from saccade.io.files import results_in

if TYPE_CHECKING:
    from saccade.simulation import WorldConfig

GAZE_SUMMARIES = "; ".join(f"{row.name}: {row.summary}" for row in POLICIES.values())
GAZE_HELP = (
    f"Gaze policy that turns the camera during mapping, or module:function. {GAZE_SUMMARIES}."
)


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(SettingsOptions, JsonOptions):
    """Options of `saccade simulate`."""

    out: Annotated[Path | None, OUTPUT, OUT] = None
    """Output folder: saccade-world or saccade-simulated-drive by default."""
    seed: int = setting(0, 0)
    """Seed of the random number generator, at least 0."""
    preset: Annotated[str | None, INPUT, Parameter(("--preset", "-p"), metavar="NAME")] = None
    """Preset of a world (loop, slippery, coarse or car) or of a drive (ring, mono, repeated,
    mirror, dark, flicker, rooms or hall)."""
    frames: int | None = setting(None, 2)
    """Number of frames of a drive, at least 2; by default two laps of 300 frames."""
    gaze: Annotated[str | None, Parameter(metavar="POLICY", help=GAZE_HELP)] = None
    egomotion: Egomotion = "camera"
    """Source of odometry: camera, second-camera (fixed to the robot) or wheels."""
    color: bool = False
    """Render a drive in color."""
    depth: bool = False
    """Also render depth images."""
    tags: int | None = setting(None, 1)
    """Number of tags (tag36h11) on the outer walls of a drive."""
    tag_size: Annotated[float | None, Parameter(metavar="METERS")] = None
    """Side of the black square of these tags; 0.4 by default."""


World: TypeAlias = Annotated[
    Literal["world", "drive"],
    Parameter(
        help="world: a landmark log of a robot or a car. drive: a camera drive of a robot around a "
        "courtyard with posters."
    ),
]


def simulate(kind: World, /, options: SimulateOptions = SimulateOptions()) -> Result:
    """Simulate a landmark log or a camera drive, with ground truth.

    World: --out receives the log (log.csv, for saccade slam), the true
    trajectory (truth.tum) and the true landmarks (landmarks.csv). The seed
    determines the noise, but not the landmarks.

    Drive: --out receives, in the layout of KITTI's odometry benchmark and for
    saccade drive, the images of the left (image_0) and right camera (image_1),
    the calibration (calib.txt, camera.toml), times.txt, odometry with its
    covariance (odometry.csv) and the true trajectory (groundtruth.tum); with
    --gaze also the camera's rotation (gaze.csv), with --tags also the true
    positions of the tags (tags.csv). The seed determines the noise,
    the walls and the posters.

    Example: saccade simulate drive --preset repeated --seed 7 --out ring
    """
    from saccade.simulation import simulate_drive, tag_layout
    from saccade.simulation.gaze_drive import gaze_drive

    settings = options.settings(kind)
    frames, gaze, seed = options.frames, options.gaze, options.seed
    color, depth = options.color, options.depth
    if kind == "world":
        if frames or gaze or color or depth or options.tags:
            names = "--frames, --gaze, --color, --depth, --tags"
            raise ConfigError(f"{names}: expected a drive, found world")
        return _simulate_world(options.out or Path("saccade-world"), settings, seed)
    if frames is not None:
        settings = replace(settings, frames=frames)
    settings = replace(settings, color=settings.color or color, depth=settings.depth or depth)
    given = {"tags": options.tags, "tag_size": options.tag_size}
    settings = replace(settings, **{k: v for k, v in given.items() if v is not None})
    if gaze is None:
        simulated = simulate_drive(settings, seed)
    else:
        with progress_bar("looking", settings.frames) as update:
            simulated, _ = gaze_drive(settings, gaze, seed, update, egomotion=options.egomotion)
    out = options.out or Path("saccade-simulated-drive")
    with progress_bar("rendering", len(simulated)) as update:
        datasets.save_drive(out, simulated, update)
    if settings.tags > 0:
        datasets.write_landmarks(out / "tags.csv", tag_layout(settings, seed))
    row = {
        "sequence": str(out),
        "frames": len(simulated),
        "cameras": 2 if simulated.camera.baseline > 0 else 1,
        "truth": repr(simulated.truth),
        "tags": settings.tags or None,
        "tag_size_m": settings.tag_size if settings.tags else None,
    }
    return Result(row, [facts_table(f"{simulated.name} -> {out}", row)])


def _simulate_world(out: Path, settings: "WorldConfig", seed: int) -> Result:
    from saccade.simulation import simulate_world

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
    return Result(row, [facts_table(f"{log.name} -> {out}", row)])
