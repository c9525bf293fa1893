"""Saliency and gaze of a video, for `saccade look`."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from saccade.attention.models import AttentionModel
from saccade.attention.video import VideoConfig, VideoSaliency
from saccade.cli.output import Table, facts_table, progress_bar, write_arrays
from saccade.io.video import frame_times, rate_of, read_video, video_writer
from saccade.types import FloatArray
from saccade.viewing.attention import heat_beside

LONGEST = 10.0
"""Maximum seconds for which the film shows a frame."""


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
    film, times, maps = Path(f"{out}.mp4"), frame_times(path)[::every], list[Any]()
    rate = rate_of(times)
    with progress_bar(path.name, len(times)) as progress, video_writer(film, rate) as write:
        frames = zip(read_video(path, every), repeats_of(times, rate), strict=False)
        for (time, frame), repeats in frames:
            maps.append(video(frame, time))
            shown = heat_beside(frame, maps[-1].saliency, maps[-1].gaze)
            for _ in range(repeats):
                write(shown)
            progress(len(maps))
    saliency, gaze = np.stack([each.saliency for each in maps]), [each.gaze for each in maps]
    arrays = {"saliency": saliency, "time": times[: len(maps)], "gaze": np.array(gaze)}
    write_arrays(Path(f"{out}.npz"), arrays)
    row = {"image": str(path), "frames": len(maps), "film": str(film)}
    return row | {"arrays": f"{out}.npz"}


def repeats_of(times: FloatArray, rate: float) -> list[int]:
    """Number of frames at a constant rate for each frame at times (n,), which keeps its time.

    The last frame lasts as long as the one before it; no frame lasts over `LONGEST` seconds.
    """
    last = times[-1] - times[-2] if len(times) > 1 else 1 / rate
    slots = np.rint(np.append(times, times[-1] + last) * rate)
    return [int(count) for count in np.diff(slots).clip(0, LONGEST * rate)]


def video_table(row: dict[str, Any]) -> Table:
    """The number of frames and the film."""
    return facts_table(row["image"], {name: row[name] for name in ("frames", "film")})
