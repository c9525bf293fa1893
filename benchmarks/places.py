"""Place recognition on photographs of several laps along one route.

    uv run python benchmarks/places.py hallway --lap 40

The photographs are ordered by the numbers in their names. Revisits: those after the first lap;
detections: those matched to an earlier one; correct: a whole number of laps away, to within two.
"""

import argparse
from pathlib import Path

from saccade import Sift, SiftConfig, read_image
from saccade.io.image import find_images
from saccade.visual.loop_detection import LoopDetectionConfig, LoopDetector

TOLERANCE = 2


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
    detector = LoopDetector(LoopDetectionConfig(min_inliers=given.min_inliers))
    detections, correct = 0, 0
    for frame, path in enumerate(paths):
        found = detector.detect(sift(read_image(path)))
        if found is not None:
            detections += 1
            right = abs((frame - found.place + lap // 2) % lap - lap // 2) <= TOLERANCE
            correct += right
            print(f"{path.name:20} {paths[found.place].name:20} {found.inliers:4} {right}")
    revisits = max(len(paths) - lap, 0)
    print(f"{len(paths)} photographs, {revisits} revisits, {detections} detections")
    if detections and revisits:
        print(f"precision {correct / detections:.3f}, recall {correct / revisits:.3f}")


if __name__ == "__main__":
    main()
