"""What `saccade look` does with a video."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.attention.models import AttentionModel


def analyze_video(path: Path, out: Path, attention: "AttentionModel", every: int) -> dict[str, Any]:
    """Look at a video: write `out`.mp4 and `out`.npz, give the row for --json.

    The film has the frame at the left and its saliency as heat at the right; the arrays are the
    saliency maps (n, h, w) and the times (n,) in seconds.

    Args:
        path: the video.
        out: what is written, without its suffix.
        attention: the model.
        every: take one frame of so many.
    """
    import numpy as np
    from rich.markup import escape
    from rich.progress import Progress

    from saccade.cli.output import messages, write_arrays
    from saccade.video import read_video, video_rate, video_writer
    from saccade.viewing import heat_beside

    times, maps = [], []
    console = messages()
    film = Path(f"{out}.mp4")
    with (
        Progress(console=console, transient=True, disable=not console.is_terminal) as progress,
        video_writer(film, video_rate(path) / every) as write,
    ):
        task = progress.add_task(escape(path.name), total=None)
        for time, frame in read_video(path, every):
            saliency = attention.maps(frame).saliency
            write(heat_beside(frame, saliency))
            times.append(time)
            maps.append(saliency)
            progress.advance(task)
    arrays = Path(f"{out}.npz")
    write_arrays(arrays, {"saliency": np.stack(maps), "time": np.array(times)})
    return {"image": str(path), "frames": len(maps), "film": str(film), "arrays": str(arrays)}
