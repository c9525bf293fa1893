"""What is symmetric about a place: the map, and the pairs of edges that made it."""

from importlib.resources import files

import saccade
from saccade.viewing import attention_figure, save_figure

image = saccade.read_image(files("saccade") / "data" / "coffee.jpg")
maps = saccade.symmetry_saliency(image)
path = saccade.scanpath(maps.saliency, image.shape, fixations=4)

about = [saccade.symmetric_pairs(image, (x, y), radius=8)[:12] for x, y in path.xy]
for (x, y), pairs in zip(path.xy, about, strict=True):
    levels = ", ".join(map(str, sorted(set(pairs.level.tolist()))))
    print(f"at ({x:3.0f}, {y:3.0f}): the strongest pairs are of pyramid levels {levels}")

save_figure(attention_figure(image, {"symmetry": maps.saliency}, path, about), "symmetry.png")
