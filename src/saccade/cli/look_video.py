"""Saliency and gaze of a video, for `saccade look`."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from saccade.attention.models import AttentionModel
from saccade.attention.video import VideoConfig, VideoSaliency
from saccade.cli.output import Table, facts_table, progress_bar, write_arrays
from saccade.io.video import read_video, video_rate, video_writer
from saccade.viewing.attention import heat_beside


def look_at_video(path: Path, out: Path, attention: AttentionModel, every: int) -> dict[str, Any]:
    """Write a film (H, 2 W) of the gaze over the video and its saliency, and the arrays.

    `out`.npz has the saliency (n, h, w), the times (n,) in seconds and the gaze (n, 2) in pixels,
    for every nth frame. If the model has a center prior, the gaze model uses none.

    Returns:
        The row for --json.
    """
    config = VideoConfig()
    if getattr(attention.settings, "center_prior", None) is not None:
        config = replace(config, scanpath=replace(config.scanpath, center_sigma=None))
    video = VideoSaliency(config, lambda frame: attention.maps(frame).saliency)
    film, times, maps = Path(f"{out}.mp4"), list[float](), list[Any]()
    with progress_bar(path.name) as progress, video_writer(film, video_rate(path) / every) as write:
        for time, frame in read_video(path, every):
            times.append(time)
            maps.append(video(frame, time))
            write(heat_beside(frame, maps[-1].saliency, maps[-1].gaze))
            progress(len(times))
    saliency, gaze = np.stack([each.saliency for each in maps]), [each.gaze for each in maps]
    arrays = {"saliency": saliency, "time": np.array(times), "gaze": np.array(gaze)}
    write_arrays(Path(f"{out}.npz"), arrays)
    row = {"image": str(path), "frames": len(times), "film": str(film)}
    return row | {"arrays": f"{out}.npz"}


def video_table(row: dict[str, Any]) -> Table:
    """The number of frames and the film."""
    return facts_table(row["image"], {name: row[name] for name in ("frames", "film")})
