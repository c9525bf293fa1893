"""Points and regions of local symmetry: MUST and SymRoID compared with SIFT."""

from importlib.resources import files

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import saccade
from saccade.viewing import save_figure
from saccade.viewing.keypoints import draw_keypoints
from saccade.viewing.style import BLUE, ORANGE, picture_axes

image = saccade.read_image(files("saccade") / "data" / "chelsea.jpg")
points = {
    "SIFT": saccade.Sift(saccade.SiftConfig(max_keypoints=30))(image),
    "MUST": saccade.Must(saccade.MustConfig(max_keypoints=30))(image),
}
regions = saccade.SymRoid(saccade.SymRoidConfig(max_keypoints=12))(image)

figure = Figure(figsize=(12, 3.1), layout="compressed", dpi=110)
panels = figure.subplots(1, 3)
for axes in panels:
    axes.imshow(image)
for axes, (name, keypoints) in zip(panels, points.items(), strict=False):
    picture_axes(axes, f"{name}: {len(keypoints)} strongest points")
    draw_keypoints(axes, keypoints)
    print(f"{name}: median size {sorted(keypoints.size)[len(keypoints) // 2]:.1f} px")
picture_axes(panels[2], f"SymRoID: {len(regions)} regions")
for left, top, right, bottom in regions.boxes.tolist():
    box = Rectangle((left, top), right - left, bottom - top, fill=False, color=ORANGE)
    panels[2].add_patch(box)
panels[2].plot(*regions.xy.T, "+", color=BLUE)
print(regions)
save_figure(figure, "regions.png")
