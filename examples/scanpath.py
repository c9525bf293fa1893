"""Scanpaths of three saliency models, scored on positions marked by hand."""

from importlib.resources import files

import numpy as np

import saccade
from saccade.evaluation.fixations import auc, nss
from saccade.viewing import save_figure
from saccade.viewing.attention import draw_scanpath
from saccade.viewing.style import figure_for, picture_axes

image = saccade.read_image(files("saccade") / "data" / "chelsea.jpg")
height, width = image.shape[:2]
marked = np.array([[172.0, 111], [312, 140], [262, 232]])  # eyes and nose, not eye-tracking data

models = {
    "contrast": saccade.contrast_saliency(image),
    "symmetry": saccade.symmetry_saliency(image),
    "attention": saccade.attention_saliency(image),
}
figure = figure_for(width, height, columns=3, rows=1, panel=4.4)
for axes, (name, maps) in zip(figure.subplots(1, 3), models.items(), strict=True):
    path = saccade.scanpath(maps, fixations=5)
    distance = np.hypot(*(marked[:, None] - path.xy).transpose(2, 0, 1)).min(1)
    large = maps.upsampled["saliency"]
    scores = f"AUC {auc(large, marked):.3f}, NSS {nss(large, marked):.2f}"
    print(f"{name:8}  {scores}; marks to nearest fixation {distance.mean():.0f} px")
    axes.imshow(image)
    axes.plot(*marked.T, "x", color="white", markersize=14, markeredgewidth=3)
    draw_scanpath(axes, path)
    picture_axes(axes, f"{name}: {scores}")
save_figure(figure, "scanpath.png")
