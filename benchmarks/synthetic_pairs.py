"""Image pairs related by an exactly known homography, made from photographs.

    uv run python benchmarks/synthetic_pairs.py PAIRS [--images DIR]     then
    saccade evaluate features --pairs PAIRS --detector opencv-root --detector sift --points 1000

Quoted in docs/keypoints.md and docs/evaluation.md. A photograph hangs on a plane. Every view of it
is resampled, degraded and compressed on its own, so that the pixels of no view are those of the
photograph.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from measuring import DATA, arguments
from saccade.errors import Settings, setting
from saccade.io.image import as_gray, find_images, read_image
from saccade.keypoints.two_view_fit import project
from saccade.types import Float32Array, FloatArray

PHOTOGRAPHS = (
    *("astronaut", "camera", "chelsea", "coffee", "gravel", "hallway_1"),
    *("hallway_2", "hubble", "retina", "rocket", "text"),
)
"""Photographs of this package that have texture enough."""
VIEW_SIDE = 640
"""Longer side in pixels to which larger photographs are reduced."""
NEAREST = 1.4
"""Largest magnification of a photograph in a view."""
MIDDLE_GRAY = 0.5
"""Gray level of the wall around a photograph."""


@dataclass(frozen=True)
class SyntheticPairsConfig(Settings):
    """Numbers of views, and the ranges from which each draws its pose and its degradation."""

    min_pairs: int = setting(200, 1, 100_000)
    """Number of pairs at least; each photograph has as many first views as that takes."""
    views: int = setting(5, 1, 1000)
    """Second views for each first one."""
    seed: int = 20261126
    """Seed of all draws."""
    scale: float = setting(4.0, 1, 16)
    """Largest ratio of the sizes of two views; drawn uniformly in its logarithm."""
    turn: float = setting(60.0, 0, 180)
    """Largest roll of the second view, in degrees."""
    tilt: float = setting(45.0, 0, 70)
    """Largest angle in degrees between the second view's direction and the normal of the plane."""
    noise: float = setting(8.0, 0, 100)
    """Largest standard deviation of the noise, in gray levels of 255."""
    blur: float = setting(1.5, 0, 20)
    """Largest standard deviation of the blur, in pixels."""
    gamma: float = setting(1.6, 1, 5)
    """Largest exponent of the brightness, or one over it."""
    quality: int = setting(40, 1, 95)
    """Lowest quality of the JPEG compression; the highest is 95."""


def write_synthetic_pairs(
    folder: Path,
    photographs: Path | None = None,
    config: SyntheticPairsConfig | None = None,
) -> None:
    """Write sequences in the layout of `homography_pairs`.

    Args:
        folder: receives a folder for each first view.
        photographs: folder of image files; None for those of this package.
        config: numbers of views and their ranges.
    """
    config = config or SyntheticPairsConfig()
    paths = packaged_photographs() if photographs is None else find_images(photographs)
    sequences = math.ceil(config.min_pairs / (config.views * len(paths)))
    for number, path in enumerate(paths):
        photograph = reduced(as_gray(read_image(path)))
        for sequence in range(sequences):
            rng = np.random.default_rng((config.seed, number, sequence))
            place = folder / f"{path.stem}-{sequence + 1}"
            place.mkdir(parents=True)
            sizes = NEAREST * config.scale ** -rng.uniform(0, 1, config.views)
            # The first view is as near as any of the second, or between the nearest and farthest.
            size = NEAREST * config.scale ** (-0.5 * (sequence % 2))
            target = target_of(photograph.shape, size, rng)
            first = view_homography(photograph.shape, target, size)
            write_view(place / "1.png", photograph, first, config, rng)
            for k, size in enumerate(sizes, start=2):
                pose = rng.uniform([-config.turn, 0, 0], [config.turn, config.tilt, 360])
                second = view_homography(photograph.shape, target, size, *np.radians(pose))
                write_view(place / f"{k}.png", photograph, second, config, rng)
                np.savetxt(place / f"H_1_{k}.txt", second @ np.linalg.inv(first))


def packaged_photographs() -> list[Path]:
    """The photographs that come with this package."""
    return [DATA / f"{name}.jpg" for name in PHOTOGRAPHS]


def reduced(gray: Float32Array) -> Float32Array:
    """An image whose longer side is at most `VIEW_SIDE` pixels."""
    factor = VIEW_SIDE / max(gray.shape)
    if factor >= 1:
        return gray
    height, width = (round(side * factor) for side in gray.shape)
    return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA))


def target_of(shape: tuple[int, ...], size: float, rng: np.random.Generator) -> FloatArray:
    """(2,) position on a photograph that lies in the middle of a view with little beside it."""
    center = np.array([shape[1] - 1, shape[0] - 1]) / 2
    reach = max(0.05, 1 - 1 / size) * center
    return center + rng.uniform(-reach, reach)


def view_homography(
    shape: tuple[int, ...],
    target: FloatArray,
    size: float,
    turn: float = 0.0,
    tilt: float = 0.0,
    azimuth: float = 0.0,
) -> FloatArray:
    """(3, 3) homography from a photograph to a view of the same size in pixels.

    The camera's focal length is the diagonal of the photograph.

    Args:
        shape: (H, W) of the photograph.
        target: (2,) position on it that lies in the middle of the view.
        size: magnification there.
        turn: roll of the camera in radians.
        tilt: angle between its direction and the normal of the photograph.
        azimuth: direction on the photograph in which it is tilted.
    """
    center = np.array([shape[1] - 1, shape[0] - 1]) / 2
    focal = float(np.hypot(shape[0], shape[1]))
    toward, roll = (cv2.Rodrigues(np.array([0, 0, a]))[0] for a in (-azimuth, turn))
    lean = cv2.Rodrigues(np.array([tilt, 0, 0]))[0]
    rotation = roll @ toward.T @ lean @ toward
    plane = np.array([[1, 0, -target[0]], [0, 1, -target[1]], [0, 0, 1]])
    pose = np.column_stack([rotation[:, 0], rotation[:, 1], [0, 0, focal / size]])
    camera = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1]])
    homography = camera @ pose @ plane
    scaled: FloatArray = homography / homography[2, 2]
    return scaled


def write_view(
    path: Path,
    photograph: Float32Array,
    homography: FloatArray,
    config: SyntheticPairsConfig,
    rng: np.random.Generator,
) -> None:
    """Render a view of a photograph, degrade it, compress it as JPEG, and write it as PNG."""
    view = rendered(photograph, homography)
    sigma = rng.uniform(0, config.blur)
    if sigma > 0.1:
        view = np.asarray(cv2.GaussianBlur(view, (0, 0), sigma))
    exponent = config.gamma ** rng.uniform(-1, 1)
    bright = 255 * view.clip(0, 1) ** exponent
    noisy = bright + rng.normal(0, rng.uniform(0, config.noise), view.shape)
    levels = np.rint(noisy.clip(0, 255)).astype(np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(config.quality, 96))]
    _, data = cv2.imencode(".jpg", levels, quality)
    cv2.imwrite(str(path), np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)))


def rendered(photograph: Float32Array, homography: FloatArray) -> Float32Array:
    """A view of a photograph before gray, of its size, each pixel the mean over its area."""
    height, width = photograph.shape
    grid = np.stack(np.meshgrid(np.arange(0, width, 8.0), np.arange(0, height, 8.0)), axis=-1)
    seen = project(np.linalg.inv(homography).astype(np.float64), grid.reshape(-1, 2))
    spacing = np.abs(np.diff(seen.reshape(grid.shape), axis=1)).max() / 8
    samples = int(np.clip(np.ceil(2 * spacing), 2, 12))  # of each pixel, along each axis
    dense = np.array([[samples, 0, (samples - 1) / 2], [0, samples, (samples - 1) / 2], [0, 0, 1]])
    view = cv2.warpPerspective(
        photograph,
        dense @ homography,
        (samples * width, samples * height),
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=MIDDLE_GRAY,
    )
    return np.asarray(cv2.resize(view, (width, height), interpolation=cv2.INTER_AREA))


def main() -> None:
    given = arguments(
        __doc__,
        pairs={"flags": "pairs", "type": Path, "help": "new folder"},
        images={"type": Path, "help": "folder of photographs, by default those of the package"},
    )
    write_synthetic_pairs(given.pairs, given.images)


if __name__ == "__main__":
    main()
