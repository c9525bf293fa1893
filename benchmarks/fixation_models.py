"""Models of fixations side by side (docs/measured.md, docs/fitting.md).

    uv run python benchmarks/fixation_models.py IMAGES FIXATIONS

Every row is scored on the same images as `saccade evaluate fixations` does, with 95 % bootstrap
intervals over the images: the presets of this package, peers, a Gaussian in the center and the
other images' fixations, which ignore the image, and people: each subject against the others. Two
peers are written here from their papers: GBVS (Harel, Koch & Perona, *Graph-based visual saliency*,
NIPS 2006; feature maps of 32 pixels, sigma .15 and .06 of their width) and BMS (Zhang & Sclaroff,
*Exploiting surroundedness for saliency detection*, TPAMI 2016; 400 pixels, thresholds 8 of 255
apart, opening by 5 and dilation by 7 pixels, smoothing by 9).
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from measuring import arguments, with_interval
from saccade.attention import (
    AttentionConfig,
    ContrastConfig,
    attention_saliency,
    boolean_saliency,
    contrast_saliency,
    symmetry_saliency,
)
from saccade.attention.channels import whitened
from saccade.datasets.fixations import read_fixations
from saccade.evaluation.prediction import (
    FixationData,
    Model,
    PredictionScores,
    score_models,
    score_people,
)
from saccade.io.image import in_unit_range
from saccade.scale.pyramid import resize

SIGMA = 24.0
"""Pixels per degree of visual angle."""
NODES = 32
"""Cells along the longer side of GBVS's feature maps."""
BMS_SIDE = 400
"""Longer side of the image in pixels for BMS."""
BMS_THRESHOLDS = 32
"""Number of its thresholds."""
SCORES = ("shuffled_auc", "auc", "nss", "cc", "information_gain")
MODELS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "attention (default)": lambda image: attention_saliency(image).saliency,
    "attention, free_viewing": lambda image: (
        attention_saliency(image, AttentionConfig.free_viewing()).saliency
    ),
    "symmetry (default)": lambda image: symmetry_saliency(image).saliency,
    "Boolean maps (default)": lambda image: boolean_saliency(image).saliency,
    "contrast (default)": lambda image: contrast_saliency(image).saliency,
    "contrast, itti1998": lambda image: (
        contrast_saliency(image, ContrastConfig.itti1998()).saliency
    ),
    "SaliencyToolbox 2": lambda image: (
        contrast_saliency(image, ContrastConfig.saliencytoolbox2()).saliency
    ),
    "BMS (Zhang & Sclaroff)": lambda image: bms(image),
    "GBVS (Harel et al.)": lambda image: gbvs(image),
}


def bms(image: np.ndarray) -> np.ndarray:
    """Boolean map saliency, by the sizes of its authors."""
    scale = min(1.0, BMS_SIDE / max(image.shape[:2]))
    shape = tuple(round(side * scale) for side in image.shape[:2])
    opened, dilated = (cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (d, d)) for d in (5, 7))
    total = np.zeros(shape, np.float32)
    for plane in np.moveaxis(whitened(resize(in_unit_range(image), shape)), 2, 0):
        levels = np.linspace(plane.min(), plane.max(), 2 * BMS_THRESHOLDS + 1)[1::2]
        for above in (plane > level for level in levels):
            for boolean_map in (above, ~above):
                figure = cv2.morphologyEx(boolean_map.view(np.uint8), cv2.MORPH_OPEN, opened)
                _, labels = cv2.connectedComponents(figure, connectivity=8)
                border = np.r_[labels[0], labels[-1], labels[:, 0], labels[:, -1]]
                figure = cv2.dilate((~np.isin(labels, [*{0, *border}])).view(np.uint8), dilated)
                total += figure / np.float32(max(np.sqrt(figure.sum()), 1))
    return cv2.GaussianBlur(total, (0, 0), 9 / BMS_SIDE * max(shape), borderType=cv2.BORDER_REFLECT)


def gbvs(image: np.ndarray) -> np.ndarray:
    """Graph-based saliency: the equilibria of random walks over the feature maps."""
    rgb = (image if image.ndim == 3 else np.repeat(image[:, :, None], 3, 2))[..., :3]
    rgb = rgb.astype(np.float32) / (255 if rgb.dtype == np.uint8 else 1)
    scale = NODES / max(rgb.shape[:2])
    shape = tuple(max(2, round(side * scale)) for side in rgb.shape[:2])
    total = np.zeros(shape)
    for channel in feature_maps(rgb):
        conspicuity = np.zeros(shape)
        for feature in channel:
            values = cv2.resize(feature, shape[::-1], interpolation=cv2.INTER_AREA)
            conspicuity += concentrated(activation(values))
        total += (conspicuity - conspicuity.min()) / (np.ptp(conspicuity) or 1)
    return cv2.GaussianBlur(resize(total.astype(np.float32), image.shape[:2]), (0, 0), SIGMA / 1.5)


def feature_maps(rgb: np.ndarray) -> list[list[np.ndarray]]:
    """Intensity, color opponency and orientation at three levels."""
    intensity, color, orientation = [], [], []
    for level in (2, 3, 4):
        r, g, b = np.moveaxis(
            cv2.resize(rgb, None, fx=0.5**level, fy=0.5**level, interpolation=cv2.INTER_AREA), 2, 0
        )
        mean = (r + g + b) / 3
        intensity.append(mean)
        color += [np.abs(r - g), np.abs(b - np.minimum(r, g))]
        for angle in (0, 45, 90, 135):
            even, odd = (
                cv2.getGaborKernel((9, 9), 7 / 3, np.deg2rad(angle), 7, 1, phase, cv2.CV_32F)
                for phase in (0, np.pi / 2)
            )
            energy = [cv2.filter2D(mean, -1, kernel - kernel.mean()) for kernel in (even, odd)]
            orientation.append(np.hypot(*energy))
    return [intensity, color, orientation]


def activation(values: np.ndarray) -> np.ndarray:
    """The equilibrium of a walk that moves to near cells where the map differs.

    Its weights are symmetric, so that it is in proportion to their sum at each cell.
    """
    level = values.ravel()
    mass = (np.abs(level[:, None] - level) * near(values.shape, 0.15)).sum(1)
    return mass.reshape(values.shape)


def concentrated(values: np.ndarray) -> np.ndarray:
    """The equilibrium of a walk that moves to near cells where the map is high.

    In proportion to the map times its sum over the near cells, by detailed balance.
    """
    mass = values * (near(values.shape, 0.06) @ values.ravel()).reshape(values.shape)
    return mass / (mass.sum() or 1)


def near(shape: tuple[int, ...], sigma: float) -> np.ndarray:
    """Closeness of every pair of cells, by a fraction of the width."""
    y, x = (axis.ravel() for axis in np.indices(shape))
    squared = (y[:, None] - y) ** 2 + (x[:, None] - x) ** 2
    return np.exp(-squared / (2 * (sigma * shape[1]) ** 2))


def main() -> None:
    given = arguments(
        __doc__,
        images={"flags": "images", "type": Path},
        fixations={"flags": "fixations", "type": Path},
        drop={"type": int, "default": 1, "help": "first fixations left out (1)"},
        every={"type": int, "default": 1, "help": "score one of N images (all)"},
    )
    table = read_fixations(given.fixations)
    kept = np.isin(table.image, np.unique(table.image)[:: given.every])
    data = FixationData.of(table[kept], given.images, given.drop, SIGMA)
    models: dict[str, Model] = {
        name: lambda image, model=model: resize(model(data.read(image)), data.sizes[image])
        for name, model in MODELS.items()
    }
    models |= {"centered Gaussian": data.center, "other images' fixations": data.shuffled}
    print(f"{'':28} {'sAUC':22} {'AUC':22} {'NSS':22} {'CC':22} IG (bit)")
    for name in (*models, "people"):
        rows = score_people(data)
        if name in models:
            scored = score_models({name: models[name]}, data)
            rows = ((image, scores[name]) for image, scores in scored)
        estimate = PredictionScores(*zip(*rows, strict=True)).estimate()
        cells = (with_interval([getattr(e, key) for e in estimate], ".3f") for key in SCORES)
        print(f"{name:28} {'  '.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
