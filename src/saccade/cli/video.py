"""Videos in `saccade look`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.attention.models import AttentionModel


def analyze_video(
    path: Path, out: Path, attention: "AttentionModel", stride: int
) -> dict[str, Any]:
    """Write the saliency of a video as `out`.mp4 and `out`.npz, return the row for --json.

    The film shows each frame beside its saliency; the arrays are the saliency (n, h, w) and the
    times (n,) in seconds.

    Args:
        path: the video.
        out: the files without suffix.
        attention: the saliency model.
        stride: every how many frames one is used.
    """
    import numpy as np

    from saccade.cli.output import progress_bar, write_arrays
    from saccade.video import read_video, video_rate, video_writer
    from saccade.viewing import heat_beside

    times, maps = [], []
    film = Path(f"{out}.mp4")
    with (
        progress_bar(path.name) as progress,
        video_writer(film, video_rate(path) / stride) as write,
    ):
        for time, frame in read_video(path, stride):
            saliency = attention.maps(frame).saliency
            write(heat_beside(frame, saliency))
            times.append(time)
            maps.append(saliency)
            progress(len(maps))
    arrays = Path(f"{out}.npz")
    write_arrays(arrays, {"saliency": np.stack(maps), "time": np.array(times)})
    return {"image": str(path), "frames": len(maps), "film": str(film), "arrays": str(arrays)}
