"""The textbook against the presets that follow it, and against the default of SIFT.

    uv run python benchmarks/textbook.py [IMAGE ...]

For each image the correlation of the contrast
maps, and how many keypoints of the textbook the preset finds within 0.1 px and a tenth of the
scale; then pop-out of a color. The figures are in `docs/appendices.md`.
"""

import inspect
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import saccade
from measuring import DATA, arguments
from saccade.textbook import contrast_saliency, sift
from saccade.textbook.contrast_saliency import ContrastSaliency
from saccade.textbook.pop_out import pop_out_display, target_rank
from saccade.types import Float32Array, Keypoints
from saccade.viewing.textbook.parameters import load_module

MAPS = ("saliency", "intensity", "color", "orientation")
PHOTOGRAPHS = ("coffee", "chelsea", "rocket", "astronaut", "hallway_1")


def main() -> None:
    given = arguments(__doc__, images={"flags": "images", "nargs": "*"})
    photographs = [str(DATA / f"{name}.jpg") for name in PHOTOGRAPHS]
    print("image:", *MAPS, "| printed, found, others, median and least cosine of descriptors")
    for path in given.images or photographs:
        image = saccade.read_image(path)
        correlations = " ".join(f"{each:.5f}" for each in map_agreement(image))
        print(f"{path.rpartition('/')[2]}: {correlations} | {sift_agreement(image)}")
    compare_default(photographs)
    compare_pop_out()


def map_agreement(image: Float32Array) -> list[float]:
    """The correlation of each map of the preset with the textbook's; 1 where both are flat."""
    printed = contrast_saliency(image)
    found = saccade.contrast_saliency(image, saccade.ContrastConfig.kootstra2010())
    pairs = [(getattr(printed, name), getattr(found, name)) for name in MAPS]
    return [
        1.0 if np.ptp(a) == np.ptp(b) == 0 else float(np.corrcoef(a.ravel(), b.ravel())[0, 1])
        for a, b in pairs
    ]


def sift_agreement(image: Float32Array) -> str:
    """Keypoints of the textbook, those found, those of the preset alone, and the descriptors."""
    config = replace(saccade.SiftConfig.kootstra2010(), descriptor_dtype="float32")
    printed, found = sift(image).keypoints, saccade.Sift(config)(image)
    here, cosines = _near(printed, found)
    there, _ = _near(found, printed)
    middle, least = (float(f(cosines)) if here.any() else np.nan for f in (np.median, np.min))
    return f"{len(printed)} {here.sum()} {(~there).sum()} {middle:.5f} {least:.4f}"


def _near(points: Keypoints, among: Keypoints) -> tuple[np.ndarray, np.ndarray]:
    if len(points) == 0 or len(among) == 0:
        return np.zeros(len(points), bool), np.empty(0)
    assert points.descriptors is not None
    assert among.descriptors is not None
    apart = np.linalg.norm(points.xy[:, None] - among.xy, axis=2)  # (n, k)
    near = (apart <= 0.1) & (np.abs(among.size / points.size[:, None] - 1) <= 0.1)
    turned = np.abs(np.angle(np.exp(1j * (points.angle[:, None] - among.angle))))
    cosine = np.where(near & (turned < 0.1), points.descriptors @ among.descriptors.T, -1)
    best = cosine.max(axis=1)
    return near.any(axis=1), best[best > -1]


def compare_default(photographs: list[str]) -> None:
    """What the default of SIFT adds: centers of blobs, and orientations a point."""
    fast = saccade.Sift()
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:64, :64]
    errors = []
    for sigma in np.repeat([2.5, 3.0, 3.5, 4.0], 10):
        center = 31 + rng.random(2)
        blob = 0.1 + 0.8 * np.exp(-((x - center[0]) ** 2 + (y - center[1]) ** 2) / (2 * sigma**2))
        found = sift(blob).keypoints, fast(blob.astype(np.float32))
        errors.append([np.linalg.norm(each.xy - center, axis=1).min() for each in found])
    textbook, default = np.mean(errors, axis=0)
    print(f"40 blobs, mean error of the center: textbook {textbook:.3f}, default {default:.4f} px")
    counts = []
    for path in photographs:
        image = saccade.read_image(path)
        printed, ours = sift(image), fast(image)
        kept = sum(each.status == "kept" for each in printed.candidates)
        counts.append([len(printed.keypoints) / kept, len(ours) / len(np.unique(ours.xy, axis=0))])
    textbook, default = np.mean(counts, axis=0)
    print(f"orientations a point, mean of five: textbook {textbook:.2f}, default {default:.2f}")


def compare_pop_out() -> None:
    """In how many of ten displays the red bar is the most salient, by model and background."""
    source = inspect.getsource(sys.modules["saccade.textbook.contrast_saliency"])
    brightest = " / rgb.max(-1, initial=BLACK)"
    models = {
        "printed": contrast_saliency,
        "undivided": changed(source, brightest, ""),
        "signed": changed(source, "np.abs(center - ", "np.maximum(0, center - "),
        "default": saccade.contrast_saliency,
    }
    for background in (0.5, 0.0):
        displays = [pop_out_display(seed, background) for seed in range(10)]
        counts = {
            name: sum(target_rank(model(image).saliency, *bars) == 1 for image, *bars in displays)
            for name, model in models.items()
        }
        print(f"pop-out in ten displays on {background}:", counts)


def changed(source: str, old: str, new: str) -> Callable[[Float32Array], ContrastSaliency]:
    """The contrast saliency of the textbook with another expression."""
    assert old in source
    return load_module(source.replace(old, new), "contrast_saliency.py").contrast_saliency


if __name__ == "__main__":
    main()
