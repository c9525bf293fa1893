"""Channel weights fitted to fixations by gradient descent, and by the solver of `saccade fit`."""

from importlib.resources import files
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
import torch

import saccade
import saccade.torch
from saccade.evaluation.fitting import FittingConfig, FittingData, fit
from saccade.evaluation.prediction import FixationData
from saccade.types import FixationTable

CHANNELS = ("intensity", "color", "orientation")
TRUE_WEIGHTS = torch.tensor([0.6, 1.4, 0.2])
SHAPE, CELL = (240, 320), 16
PENALTY = FittingConfig().penalty

paths = sorted(Path(str(files("saccade") / "data")).glob("*.jpg"))[:10]
photos = [cv2.resize(saccade.read_image(path), SHAPE[::-1]) for path in paths]
images = torch.as_tensor(np.stack(photos) / np.float32(255)).permute(0, 3, 1, 2)
maps = saccade.torch.contrast_saliency(images, saccade.ContrastConfig(viewing_size=None))
layers = torch.stack([getattr(maps, name) for name in CHANNELS], 1)  # (B, 3, h, w)
features = (layers / layers.mean((2, 3), keepdim=True).clamp(min=1e-9) + 0.1).log()

# Fixations of a subject whose density is known
logits = torch.einsum("k,bkhw->bhw", TRUE_WEIGHTS, features).flatten(1)
cells = torch.multinomial(logits.softmax(1), 400, True, generator=torch.Generator().manual_seed(1))
rows, columns = cells // maps.saliency.shape[2], cells % maps.saliency.shape[2]
xy = torch.stack([columns, rows], 2).reshape(-1, 2).numpy() * CELL + (CELL - 1) / 2

# Gradient descent on the likelihood, and the penalty of the solver
deviation = features.transpose(0, 1).flatten(1).std(1, correction=0)
weights = torch.zeros(3, requires_grad=True)
optimizer, losses = torch.optim.Adam([weights], lr=0.05), []
for _ in range(300):
    log_density = torch.einsum("k,bkhw->bhw", weights, features).flatten(1).log_softmax(1)
    loss = -log_density.gather(1, cells).mean() + PENALTY / 2 * (weights * deviation).square().sum()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    losses.append(loss.item())

# The solver of `saccade fit` on the same features
names = [path.name for path in paths]
image = np.repeat(names, cells.shape[1])
number = np.arange(len(image)) % cells.shape[1]
table = FixationTable(image, np.zeros(len(image), np.int64), number, xy)
people = FixationData(Path(), table, dict.fromkeys(names, SHAPE))
data = FittingData(people, CHANNELS, list(features.numpy()), saccade.AttentionConfig())
solved = fit(data, FittingConfig(), ordered=False)

for k, name in enumerate(CHANNELS):
    print(
        f"{name}: {TRUE_WEIGHTS[k]:.2f} true, {weights[k]:.3f} by descent, {solved[k]:.3f} solved"
    )
plt.plot(losses)
plt.xlabel("step")
plt.ylabel("negative log-likelihood per fixation")
plt.savefig("tensors.png")
