"""Settings of SIFT: scores, times and roll (the tables of docs/keypoints.md).

    uv run python benchmarks/sift_settings.py --pairs DIR

Scores are of pairs of images of one plane, times are relative to the default's in the same run;
then come the right matches of upright and of default points between an image and itself rolled.
"""

from pathlib import Path

import cv2
import numpy as np

from measuring import arguments, times_in_turns
from saccade import Sift, SiftConfig, match
from saccade.datasets.homography_pairs import homography_pairs
from saccade.evaluation.features import score_detector

SETTINGS = {
    "default": {},
    '`descriptor="sift"`': {"descriptor": "sift"},
    "`first_octave=0`": {"first_octave": 0},
    "`upright=True`": {"upright": True},
    "`max_keypoints=1000`": {"max_keypoints": 1000},
    '`max_keypoints=1000, ranking="response"`': {"max_keypoints": 1000, "ranking": "response"},
    "`max_keypoints=1000, spread=True`": {"max_keypoints": 1000, "spread": True},
}
SCORES = ("repeatability", "mma_3", "ratio_3", "auc_5")


def right_matches(sift: Sift, image: np.ndarray, degrees: float) -> int:
    """Number of matches between an image and itself rolled that are right to 3 px."""
    height, width = image.shape
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, 1)
    rolled = cv2.warpAffine(image, turn, (width, height), flags=cv2.INTER_LANCZOS4)
    here, there = sift(image), sift(rolled)
    pairs = match(here, there)
    expected = here.xy[pairs[:, 0]] @ turn[:, :2].T + turn[:, 2]
    return int((np.hypot(*(expected - there.xy[pairs[:, 1]]).T) < 3).sum())


def main() -> None:
    given = arguments(__doc__, pairs={"type": Path, "required": True}, runs=9)
    cv2.setNumThreads(1)
    pairs = homography_pairs(given.pairs)
    image = cv2.imread(str(pairs[0].first), cv2.IMREAD_GRAYSCALE)
    sifts = {name: Sift(SiftConfig(**each), threads=1) for name, each in SETTINGS.items()}
    times = times_in_turns({name: (lambda s=s: s(image)) for name, s in sifts.items()}, given.runs)
    ratios = np.median(times / times[:, :1], axis=0)
    print("| | points | repeatability | matches right | with ratio test | homography | time |")
    print("|---|---|---|---|---|---|---|")
    for (name, sift), ratio in zip(sifts.items(), ratios, strict=True):
        mean = score_detector(sift, pairs).mean()
        cells = " | ".join(f"{getattr(mean, key):.3f}".removeprefix("0") for key in SCORES)
        print(f"| {name} | {mean.keypoints:.0f} | {cells} | {ratio:.2f} |", flush=True)
    for degrees in (5, 10, 15, 20, 25):
        upright, default = (
            right_matches(sifts[name], image, degrees) for name in ("`upright=True`", "default")
        )
        print(f"roll {degrees} degrees: {upright} right upright, {default} by default")


if __name__ == "__main__":
    main()
