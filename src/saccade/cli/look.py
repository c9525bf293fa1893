"""`saccade look`: saliency maps and scanpaths."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from saccade.cli.attention_models import (
    DEFAULT_MODEL,
    Faces,
    ModelChoice,
    attention_model,
    scanpath_network,
)
from saccade.cli.options import Config, Json, Out, Preset


class Inhibition(StrEnum):
    """Region of inhibition of return."""

    disc = "disc"
    shape = "shape"


def look(
    images: Annotated[
        list[str], Argument(metavar="IMAGE", help="Images, videos, folders, or quoted patterns.")
    ],
    out: Out = Path("saccade-look"),
    model: ModelChoice = DEFAULT_MODEL,
    preset: Preset = None,
    config: Config = None,
    faces: Faces = None,
    fixations: Annotated[
        int, Option(min=1, max=1000, metavar="N", help="Length of the scanpath.")
    ] = 10,
    inhibition: Annotated[
        Inhibition,
        Option(help="Inhibition of return: of a disc, or of the shape of a proto-object."),
    ] = Inhibition.disc,
    scanpath_film: Annotated[
        bool, Option("--scanpath-film", help="Also animate each scanpath: NAME.scanpath.gif.")
    ] = False,
    every: Annotated[int, Option(min=1, metavar="N", help="Use every Nth frame of a video.")] = 1,
    as_json: Json = False,
) -> None:
    """Compute saliency by contrast and symmetry, and a scanpath.

    Values of different models, presets and images have no common scale.

    For each image --out receives a figure (NAME.look.png) and the arrays
    (NAME.look.npz), and for all of them an interactive report (report.html);
    for each video a film (NAME.look.mp4) and the saliency of its frames
    (NAME.look.npz).
    """
    from saccade.cli.look_run import LEAD, analyze_image, analyze_video
    from saccade.cli.output import for_each_image, print_json, print_table
    from saccade.errors import ConfigError
    from saccade.image import find_images
    from saccade.video import is_video
    from saccade.viewing.report import ReportBuilder

    by_shape = inhibition is Inhibition.shape
    if by_shape and model not in (DEFAULT_MODEL, "contrast"):
        raise ConfigError(f"inhibition: a shape needs --model attention or contrast, found {model}")
    attention = attention_model(model, preset, config, keep_features=by_shape, faces=faces)
    network = scanpath_network(preset)
    builder = ReportBuilder("saccade look", LEAD)

    def process(path: Path, name: str) -> dict[str, Any]:
        file = out / f"{name}.look"
        if is_video(path):
            return analyze_video(path, file, attention, every)
        return analyze_image(
            *(path, file, attention, fixations, builder),
            network=network,
            by_shape=by_shape,
            film=scanpath_film,
        )

    paths = [path for source in images for path in find_images(source)]
    try:
        rows = for_each_image(paths, out, process)
    finally:
        report = builder.write(out / "report.html") if len(builder) else None
    if as_json:
        print_json({"images": rows, "report": None if report is None else str(report)})
        return
    for row in rows:
        if "frames" in row:
            facts = [["frames", str(row["frames"])], ["film", row["film"]]]
            print_table(row["image"], ["", ""], facts)
            continue
        print_table(
            f"{row['image']} -> {row['picture']}",
            ["fixation", "x [px]", "y [px]", "time [ms]", "saliency"],
            [
                [str(i), f"{x:.0f}", f"{y:.0f}", f"{1000 * time:.0f}", f"{saliency:.3f}"]
                for i, (x, y, time, saliency) in enumerate(row["scanpath"], start=1)
            ],
        )
