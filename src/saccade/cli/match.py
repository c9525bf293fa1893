"""`saccade match`: interest points that two images share."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from saccade.cli.detect import Most
from saccade.cli.options import Json, Out, Preset, Settings

if TYPE_CHECKING:
    from saccade.keypoints.sift import Sift


def match(
    first: Annotated[Path, typer.Argument(metavar="A", help="One photograph.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another of the same place.")],
    out: Out = Path("saccade-match"),
    preset: Preset = None,
    config: Settings = None,
    most: Most = None,
    ratio: Annotated[
        float, typer.Option(min=0, max=1, help="Nearest / second nearest distance, at most.")
    ] = 0.8,
    mutual: Annotated[bool, typer.Option(help="Keep only pairs that choose each other.")] = True,
    as_json: Json = False,
) -> None:
    """Match the interest points of two images.

    The picture (matches.png) and the list (matches.csv: x and y in both
    images) appear in --out.
    """
    from saccade.cli.detect import make_detector
    from saccade.cli.output import print_json, print_table

    row = match_images(first, second, out, make_detector(preset, config, most), ratio, mutual)
    if as_json:
        print_json(row)
        return
    print_table(
        f"matches -> {out}",
        ["image", "points", "matched"],
        [
            [str(first), str(row["first_points"]), str(row["matches"])],
            [str(second), str(row["second_points"]), str(row["matches"])],
        ],
    )


def match_images(
    first: Path,
    second: Path,
    out: Path,
    sift: "Sift",
    ratio: float,
    mutual: bool,
) -> dict[str, Any]:
    """Match two images: write matches.png and .csv into `out`, give the row for --json."""
    import numpy as np

    from saccade.cli.output import write_text
    from saccade.image import read_image
    from saccade.keypoints.matching import match as match_keypoints
    from saccade.viewing import match_figure, save_figure

    images = (read_image(first), read_image(second))
    keypoints = (sift(images[0]), sift(images[1]))
    pairs = match_keypoints(*keypoints, ratio=ratio, mutual=mutual)
    picture = save_figure(match_figure(images, keypoints, pairs), out / "matches.png")
    places = np.hstack([keypoints[0].xy[pairs[:, 0]], keypoints[1].xy[pairs[:, 1]]])
    lines = [
        f"{i},{j},{x1:.3f},{y1:.3f},{x2:.3f},{y2:.3f}"
        for (i, j), (x1, y1, x2, y2) in zip(pairs.tolist(), places.tolist(), strict=True)
    ]
    table = out / "matches.csv"
    write_text(table, "\n".join(["first,second,x1,y1,x2,y2", *lines]) + "\n")
    return {
        "first": str(first),
        "second": str(second),
        "first_points": len(keypoints[0]),
        "second_points": len(keypoints[1]),
        "matches": len(pairs),
        "picture": str(picture),
        "table": str(table),
    }
