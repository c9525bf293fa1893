"""Saliency of a photograph, its scanpath, and the symmetric pairs at the fixations."""

from importlib.resources import files

import saccade
from saccade.viewing import attention_figure, save_figure

image = saccade.read_image(files("saccade") / "data" / "astronaut.jpg")
maps = saccade.attention_saliency(image, saccade.AttentionConfig.free_viewing())
path = saccade.most_probable_scanpath(maps, fixations=8)

print(maps)
for (x, y), time in zip(path.xy, path.time, strict=True):
    print(f"{time * 1000:4.0f} ms  at ({x:3.0f}, {y:3.0f})")

shown = {
    "saliency": maps.saliency,
    "contrast": maps.contrast.saliency,
    "symmetry": maps.symmetry.saliency,
}
pairs = [saccade.symmetric_pairs(image, (x, y), radius=4)[:8] for x, y in path.xy]
save_figure(attention_figure(image, shown, path, pairs), "saliency.png")
