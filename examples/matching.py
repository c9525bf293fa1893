"""Keypoints, matches and inliers of two photographs of one hallway."""

from importlib.resources import files

import saccade
from saccade.viewing import match_figure, save_figure

data = files("saccade") / "data"
images = [saccade.read_image(data / f"hallway_{lap}.jpg") for lap in (1, 2)]

sift = saccade.Sift()  # reuses its buffers: create it once
first, second = (sift(image) for image in images)
pairs = saccade.match(first, second, ratio=0.8, mutual=True)
checked = saccade.verify(first, second, pairs, "fundamental", tolerance=2.0)

print(first, second)
print(f"{len(pairs)} matches, {checked.inliers.sum()} inliers of one fundamental matrix")
save_figure(match_figure(images, (first, second), pairs, checked.inliers), "matching.png")
