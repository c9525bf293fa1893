"""Place recognition on photographs of several laps along one route.

    uv run python benchmarks/places.py hallway --lap 40

The photographs are ordered by the numbers in their names. Revisits: those after the first lap;
detections: those matched to an earlier one; correct: a whole number of laps away, to within two.
"""

import argparse
from pathlib import Path

from saccade import Keypoints, Sift, SiftConfig, match, read_image, verify
from saccade.io.image import find_images

TOLERANCE = 2
RATIO, MIN_GAP = 0.8, 15
"""Ratio test of the matches; least number of frames between two views of a place."""


def recognized(points: Keypoints, places: list[Keypoints], needed: int) -> tuple[int, int] | None:
    """The earlier frame with the most matches that agree with one epipolar geometry, and these."""
    best = None
    for place, earlier in enumerate(places):
        pairs = match(points, earlier, ratio=RATIO)
        if len(pairs) >= needed:
            inliers = int(verify(points, earlier, pairs).inliers.sum())
            if inliers >= needed:
                best, needed = (place, inliers), inliers + 1
    return best


def number(path: Path) -> int:
    return int("0" + "".join(filter(str.isdigit, path.stem)))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--lap", type=int, required=True, help="photographs per lap")
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--min-inliers", type=int, default=22)
    given = parser.parse_args()
    lap, paths = given.lap, sorted(find_images(given.folder), key=number)
    sift = Sift(SiftConfig(max_keypoints=given.points, ranking="response", spread=True))
    detections, correct = 0, 0
    places: list[Keypoints] = []
    for frame, path in enumerate(paths):
        points = sift(read_image(path))
        found = recognized(points, places[: max(frame + 1 - MIN_GAP, 0)], given.min_inliers)
        places.append(points)
        if found is not None:
            detections += 1
            place, inliers = found
            right = abs((frame - place + lap // 2) % lap - lap // 2) <= TOLERANCE
            correct += right
            print(f"{path.name:20} {paths[place].name:20} {inliers:4} {right}")
    revisits = max(len(paths) - lap, 0)
    print(f"{len(paths)} photographs, {revisits} revisits, {detections} detections")
    if detections and revisits:
        print(f"precision {correct / detections:.3f}, recall {correct / revisits:.3f}")


if __name__ == "__main__":
    main()
