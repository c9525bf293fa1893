"""Saliency and gaze of a video, written as a film and as arrays."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.attention.models import AttentionModel
from saccade.attention.video import VideoConfig, VideoMaps, VideoSaliency
from saccade.cli.output import progress_bar, write_arrays
from saccade.io.video import read_video, video_rate, video_writer
from saccade.types import Image
from saccade.viewing import heat_beside


class VideoRecord:
    """Saliency and gaze of the frames so far.

    Args:
        attention: model of the static saliency. If it has a prior of the center, the gaze has none.
    """

    def __init__(self, attention: AttentionModel) -> None:
        config = VideoConfig()
        if getattr(attention.settings, "center_prior", None) is not None:
            config = replace(config, scanpath=replace(config.scanpath, center_sigma=None))
        self._video = VideoSaliency(config, lambda frame: attention.maps(frame).saliency)
        self._times = list[float]()
        self._maps = list[VideoMaps]()

    def __len__(self) -> int:
        return len(self._maps)

    def add(self, time: float, frame: Image) -> npt.NDArray[np.uint8]:
        """The frame of the film: (H, 2 W, 3) the gaze in this frame and in its saliency."""
        self._times.append(time)
        self._maps.append(self._video(frame, time))
        return heat_beside(frame, self._maps[-1].saliency, self._maps[-1].gaze)

    def write(self, source: str, out: Path) -> dict[str, Any]:
        """Write `out`.npz, return the row for --json; the film is `out`.mp4.

        The arrays are the saliency (n, h, w), the times (n,) in seconds, and the gaze (n, 2) in
        pixels.
        """
        arrays = Path(f"{out}.npz")
        saliency = np.stack([maps.saliency for maps in self._maps])
        gaze = np.array([maps.gaze for maps in self._maps])
        write_arrays(arrays, {"saliency": saliency, "time": np.array(self._times), "gaze": gaze})
        row = {"image": source, "frames": len(self), "film": f"{out}.mp4"}
        return row | {"arrays": str(arrays)}


def analyze_video(path: Path, out: Path, attention: AttentionModel, stride: int) -> dict[str, Any]:
    """Write the film `out`.mp4 and the arrays `out`.npz, return the row for --json."""
    record = VideoRecord(attention)
    with (
        progress_bar(path.name) as progress,
        video_writer(Path(f"{out}.mp4"), video_rate(path) / stride) as write,
    ):
        for time, frame in read_video(path, stride):
            write(record.add(time, frame))
            progress(len(record))
    return record.write(str(path), out)
