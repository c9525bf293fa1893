"""Symmetry saliency, and the edge pairs that contribute most to each fixation."""

from importlib.resources import files

import saccade
from saccade.viewing import attention_figure, save_figure

image = saccade.read_image(files("saccade") / "data" / "coffee.jpg")
maps = saccade.symmetry_saliency(image)
path = saccade.scanpath(maps, fixations=4)

pairs = [saccade.symmetric_pairs(image, (x, y), radius=8)[:12] for x, y in path.xy]
for (x, y), strongest in zip(path.xy, pairs, strict=True):
    levels = ", ".join(map(str, sorted(set(strongest.level.tolist()))))
    print(f"({x:3.0f}, {y:3.0f}): strongest pairs at pyramid levels {levels}")

save_figure(attention_figure(image, {"symmetry": maps.saliency}, path, pairs), "symmetry.png")
