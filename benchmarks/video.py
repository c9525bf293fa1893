"""Saliency of a video against OpenCV's dense optical flow (docs/attention.md).

    uv run python benchmarks/video.py

A disc moves over a panned photograph of 640 x 360 px, at 25 frames a second. `VideoSaliency` and
Farneback's flow between two frames (OpenCV, with the settings of its tutorial) take turns, on the
time of the processor; frames a second are those of one core.
"""

import time
from collections.abc import Callable

import cv2
import numpy as np

import saccade
from measuring import DATA, arguments

WIDTH, HEIGHT, RATE = 640, 360, 25
WARM = 10
"""Frames that load the kernels and move the gaze before the first that counts."""


def film(count: int) -> list[np.ndarray]:
    """Frames (HEIGHT, WIDTH, 3) uint8."""
    photo = (saccade.read_image(DATA / "rocket.jpg") * 255 + 0.5).astype(np.uint8)
    scene = cv2.resize(photo, (WIDTH + 3 * count, HEIGHT + count), interpolation=cv2.INTER_CUBIC)
    frames = [scene[n : n + HEIGHT, 3 * n : 3 * n + WIDTH].copy() for n in range(count)]
    for number, frame in enumerate(frames):
        cv2.circle(frame, (500 - 5 * number, 100), 12, (240, 240, 240), -1, cv2.LINE_AA)
    return frames


def milliseconds(action: Callable[[], object]) -> float:
    start = time.process_time()
    action()
    return 1e3 * (time.process_time() - start)


def main() -> None:
    frames = film(arguments(__doc__, frames=60).frames)
    gray = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames]
    video = saccade.VideoSaliency()
    moving = saccade.VideoSaliency(static=lambda frame: np.zeros((23, 40), np.float32))
    actions = {
        "saliency and gaze": lambda n: video(frames[n], n / RATE),
        "flicker, motion, gaze": lambda n: moving(frames[n], n / RATE),
        "Farneback's flow": lambda n: cv2.calcOpticalFlowFarneback(
            gray[n - 1], gray[n], None, 0.5, 3, 15, 3, 5, 1.2, 0
        ),
    }
    times = np.array(
        [
            [milliseconds(lambda a=action, n=n: a(n)) for action in actions.values()]
            for n in range(1, len(frames))
        ]
    )[WARM:]
    for name, column in zip(actions, times.T, strict=True):
        print(f"{name:24}{column.mean():6.1f} ms a frame, at most {column.max():.1f}")
    ours, _, theirs = times.mean(0)
    print(f"ratio {ours / theirs:.2f}; {1e3 / ours:.1f} frames a second")


if __name__ == "__main__":
    main()
