"""Saliency of a video against OpenCV's dense optical flow: `uv run python benchmarks/video.py`.

A disc moves over a panned photograph of 640 x 360 px, at 25 frames a second. `VideoSaliency` and
Farneback's flow between two frames (OpenCV, with the settings of its tutorial) take turns in one
run, and the ratio of their means is what counts; the time of the processor is measured, and the
frames a second follow from it, for one core.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

import saccade

PHOTO = Path(saccade.__file__).parent / "data" / "rocket.jpg"
WIDTH, HEIGHT, RATE = 640, 360, 25
BAR = 20
"""Frames a second."""


def film(count: int) -> list[np.ndarray]:
    """Frames (HEIGHT, WIDTH, 3) uint8."""
    photo = (saccade.read_image(PHOTO) * 255 + 0.5).astype(np.uint8)
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=60, help="number of frames (60)")
    frames = film(parser.parse_args().frames)
    gray = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames]
    video, own, motion, flow = saccade.VideoSaliency(), [], [], []
    no_static = saccade.VideoSaliency(static=lambda frame: np.zeros((23, 40), np.float32))
    for n in range(1, len(frames)):
        pair = gray[n - 1], gray[n]
        own.append(milliseconds(lambda n=n: video(frames[n], n / RATE)))
        motion.append(milliseconds(lambda n=n: no_static(frames[n], n / RATE)))
        flow.append(
            milliseconds(
                lambda pair=pair: cv2.calcOpticalFlowFarneback(
                    *pair, None, 0.5, 3, 15, 3, 5, 1.2, 0
                )
            )
        )
    warm = slice(10, None)  # kernels are loaded, and the gaze has moved
    mean, changes, peer = (float(np.mean(each[warm])) for each in (own, motion, flow))
    verdict = "met" if 1e3 / mean >= BAR else "MISSED"
    print(f"saliency and gaze       {mean:6.1f} ms a frame, at most {max(own[warm]):.1f}")
    print(f"flicker, motion, gaze   {changes:6.1f} ms")
    print(f"Farneback's flow        {peer:6.1f} ms")
    print(f"ratio {mean / peer:.2f}; {1e3 / mean:.1f} frames a second (bar {BAR}) {verdict}")


if __name__ == "__main__":
    main()
