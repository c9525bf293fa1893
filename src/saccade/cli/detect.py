"""`saccade detect`: interest points."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from saccade.cli.options import Images, Json, Out, Preset, Settings

if TYPE_CHECKING:
    from saccade.keypoints.sift import Sift

Most = Annotated[
    int | None, typer.Option("--max", min=1, help="Keep only this many, the strongest.")
]


def detect(
    images: Images,
    out: Out = Path("saccade-detect"),
    preset: Preset = None,
    config: Settings = None,
    most: Most = None,
    as_json: Json = False,
) -> None:
    """Find interest points with SIFT and describe them.

    For each image a picture (NAME.keypoints.png) and the arrays
    (NAME.keypoints.npz: xy, size, angle, response, octave, descriptors)
    appear in --out.
    """
    from saccade.cli.output import for_each_image, print_json, print_table
    from saccade.image import find_images

    sift = make_detector(preset, config, most)
    paths = [path for source in images for path in find_images(source)]
    rows = for_each_image(
        paths, out, lambda path, name: detect_in(path, out / f"{name}.keypoints", sift)
    )
    if as_json:
        print_json({"images": rows})
        return
    print_table(
        f"interest points -> {out}",
        ["image", "points", "median size [px]"],
        [[row["image"], str(row["points"]), f"{row['median_size']:.1f}"] for row in rows],
    )


def make_detector(preset: str | None, config: Path | None, most: int | None) -> "Sift":
    """A `Sift` from the options of the command line."""
    from dataclasses import replace

    from saccade.cli.settings import load_settings
    from saccade.keypoints.sift import Sift

    settings = load_settings("sift", preset, config)
    return Sift(settings if most is None else replace(settings, max_keypoints=most))


def detect_in(path: Path, out: Path, sift: "Sift") -> dict[str, Any]:
    """Detect in one image: write `out`.png and `out`.npz, give the row for --json."""
    import numpy as np

    from saccade.cli.output import write_arrays
    from saccade.image import read_image
    from saccade.viewing import keypoint_figure, save_figure

    image = read_image(path)
    keypoints = sift(image)
    picture = save_figure(keypoint_figure(image, keypoints), f"{out}.png")
    arrays = Path(f"{out}.npz")
    write_arrays(arrays, vars(keypoints))
    return {
        "image": str(path),
        "points": len(keypoints),
        "median_size": float(np.median(keypoints.size)) if len(keypoints) else 0.0,
        "picture": str(picture),
        "arrays": str(arrays),
    }
