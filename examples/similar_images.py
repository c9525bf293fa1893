"""Image retrieval: extract features, build an index, find photographs of the same place."""

from importlib.resources import files
from pathlib import Path
from shutil import copy

import saccade
from saccade.batch import Job, extract, open_source
from saccade.batch.engines import InProcess
from saccade.batch.index import Index, build_index
from saccade.viewing import match_figure, save_figure

data = Path(str(files("saccade") / "data"))
photos = Path("photos")
photos.mkdir(exist_ok=True)
for photo in data.glob("*.jpg"):
    if photo.name != "hallway_2.jpg":
        copy(photo, photos)

config = saccade.SiftConfig(max_keypoints=300)
print(extract(open_source("photos"), Job("sift", config), "features", InProcess()).totals)
build_index("features")

query = saccade.read_image(data / "hallway_2.jpg")
points = saccade.Sift(config)(query)
found = Index("features").find(points)
for image, inliers, similarity in found[:3]:
    print(f"{image:16} {inliers or 0:3} inliers, similarity {similarity:.1f}")

best = saccade.read_image(photos / found[0].image)
keypoints = saccade.Sift(config)(best)
pairs = saccade.match(points, keypoints)
inliers = saccade.verify(points, keypoints, pairs).inliers
save_figure(match_figure((query, best), (points, keypoints), pairs, inliers), "similar_images.png")
