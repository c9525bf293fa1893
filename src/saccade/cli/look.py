"""`saccade look`: saliency, conspicuity and scanpath."""

from pathlib import Path
from typing import Annotated, Any

import typer

from saccade.cli.options import Images, Json, Out, Preset, Settings


def look(
    images: Images,
    out: Out = Path("saccade-look"),
    preset: Preset = None,
    config: Settings = None,
    fixations: Annotated[int, typer.Option(min=1, max=1000, help="Length of the scanpath.")] = 10,
    as_json: Json = False,
) -> None:
    """Show where contrast draws the eye: saliency, conspicuity and scanpath.

    For each image a picture (NAME.look.png) and the arrays (NAME.look.npz) appear in --out.
    """
    from saccade.cli.output import for_each_image, print_json, print_table
    from saccade.cli.settings import load_settings

    settings = load_settings("contrast", preset, config)
    rows = for_each_image(
        images, out, lambda path, name: look_at(path, out / f"{name}.look", settings, fixations)
    )
    if as_json:
        print_json({"images": rows})
        return
    for row in rows:
        print_table(
            f"{row['image']} -> {row['picture']}",
            ["fixation", "x [px]", "y [px]", "time [ms]", "saliency"],
            [
                [str(i), f"{x:.0f}", f"{y:.0f}", f"{1000 * time:.0f}", f"{saliency:.3f}"]
                for i, (x, y, time, saliency) in enumerate(row["scanpath"], start=1)
            ],
        )


def look_at(path: Path, out: Path, settings: Any, fixations: int) -> dict[str, Any]:  # noqa: ANN401
    """Look at one image: write `out`.png and `out`.npz, give the row for --json.

    Args:
        path: the image.
        out: what is written, without its suffix.
        settings: a ContrastConfig.
        fixations: length of the scanpath.
    """
    import numpy as np

    from saccade.attention.contrast import contrast_saliency
    from saccade.attention.scanpath import scanpath
    from saccade.cli.output import write_arrays
    from saccade.errors import ImageError
    from saccade.image import read_image
    from saccade.viewing import attention_figure, save_figure

    image = read_image(path)
    try:
        maps = contrast_saliency(image, settings)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from error
    fixated = scanpath(maps.saliency, image.shape, fixations=fixations)
    layers = {
        "saliency": maps.saliency,
        "intensity": maps.intensity,
        "color": maps.color,
        "orientation": maps.orientation,
    }
    picture = save_figure(attention_figure(image, layers, fixated), f"{out}.png")
    arrays = Path(f"{out}.npz")
    scanpath_arrays = {
        "scanpath_xy": fixated.xy,
        "scanpath_time": fixated.time,
        "scanpath_saliency": fixated.saliency,
    }
    write_arrays(arrays, layers | scanpath_arrays)
    table = np.column_stack([fixated.xy, fixated.time, fixated.saliency])
    return {
        "image": str(path),
        "width": image.shape[1],
        "height": image.shape[0],
        "scanpath": table.tolist(),
        "picture": str(picture),
        "arrays": str(arrays),
    }
