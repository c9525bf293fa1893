"""The attention room once more, slow and plain: loops, SciPy and the formulas."""

import itertools

import numpy as np
from scipy import ndimage


def halve(image):
    """Blurred by [1 4 6 4 1] / 16, then read bilinearly at the centers of the coarser cells."""
    blurred = image.astype(float)
    for axis in (0, 1):
        blurred = ndimage.correlate1d(blurred, np.array([1, 4, 6, 4, 1]) / 16, axis, mode="reflect")
    return bilinear(blurred, [-(-side // 2) for side in image.shape])


def bilinear(image, shape):
    """Cells tile the image; beyond the outermost centers the outermost values hold."""
    for axis, side in enumerate(shape):
        old = image.shape[axis]
        at = (np.arange(side) + 0.5) * old / side - 0.5
        image = np.apply_along_axis(
            lambda line, at=at, old=old: np.interp(at, range(old), line), axis, image
        )
    return image


def block_mean(image, shape):
    """The mean of the cells that fall into each cell of a map that is smaller by whole factors."""
    rows, columns = image.shape[0] // shape[0], image.shape[1] // shape[1]
    return image.reshape(shape[0], rows, shape[1], columns).mean(axis=(1, 3))


def local_maxima(values, threshold, radius):
    """Sorted heights of pixels with none higher in the square around; touching ones once."""
    height, width = values.shape
    is_maximum = np.zeros(values.shape, bool)
    for y, x in np.ndindex(height, width):
        square = values[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1]
        is_maximum[y, x] = values[y, x] >= threshold and values[y, x] == square.max()
    label, count = ndimage.label(is_maximum, np.ones((3, 3)))
    return sorted(values[label == i][0] for i in range(1, count + 1))


def normalize(values, method, threshold=0.1, radius=0.05):
    """N by local maxima, with one maximum special-cased, or scaling only."""
    if np.ptp(values) < 2e-6:
        return np.zeros_like(values)
    scaled = (values - values.min()) / np.ptp(values)
    if method == "none":
        return scaled
    maxima = local_maxima(scaled, threshold, max(1, round(radius * max(values.shape))))
    if method == "local-maxima-1998":
        maxima = maxima[:-1]
    elif len(maxima) == 1:
        return scaled
    return scaled * (1 - np.mean(maxima or [0])) ** 2


def difference_of_gaussians_step(values):
    """One iteration of lateral inhibition, by the double sum at each place."""
    height, width = values.shape
    longer, shorter = max(values.shape), min(values.shape)
    terms = []
    for strength, share in ((0.5, 0.02), (1.5, 0.25)):
        sigma = max(0.5, share * longer)
        reach = int(sigma * np.sqrt(-2 * np.log(0.01)))
        if shorter // 2 - 1 > 0:
            reach = min(reach, shorter // 2 - 1)
        peak = strength / (sigma * np.sqrt(2 * np.pi))
        term = np.zeros_like(values)
        for y, x in np.ndindex(height, width):
            inside = whole = 0.0
            for dy, dx in itertools.product(range(-reach, reach + 1), repeat=2):
                weight = peak**2 * np.exp(-(dx**2 + dy**2) / (2 * sigma**2))
                whole += weight
                if 0 <= y + dy < height and 0 <= x + dx < width:
                    inside += weight
                    term[y, x] += weight * values[y + dy, x + dx]
            term[y, x] *= whole / inside
        terms.append(term)
    return np.maximum(0, values + terms[0] - terms[1] - 0.02 * values.max())


def contrast_saliency(rgb, method):
    """A.1-A.14 with the source's numbers, for sides that are multiples of 16."""
    r, g, b = np.moveaxis(rgb.astype(float), 2, 0)
    brightest = rgb.max(axis=2).astype(float)
    hue = brightest >= 0.1
    safe = np.where(hue, brightest, 1)
    pyramids = {
        "I": [(r + g + b) / 3],
        "RG": [hue * (r - g) / safe],
        "BY": [hue * (b - np.minimum(r, g)) / safe],
    }
    for levels in pyramids.values():
        while min(levels[-1].shape) > 1:
            levels.append(halve(levels[-1]))
    y, x = np.mgrid[-4:5, -4:5]
    for angle in (0, 45, 90, 135):
        wave = y * np.cos(np.deg2rad(angle)) - x * np.sin(np.deg2rad(angle))
        energy = [0] * len(pyramids["I"])
        for phase in (np.cos, np.sin):
            gabor = phase(2 * np.pi * wave / 7) * np.exp(-(x**2 + y**2) / (2 * (7 / 3) ** 2))
            gabor -= gabor.mean()
            gabor /= np.sqrt((gabor**2).sum())
            for i, level in enumerate(pyramids["I"]):
                energy[i] = energy[i] + ndimage.correlate(level, gabor, mode="reflect") ** 2
        pyramids[angle] = [np.sqrt(squared) for squared in energy]
    shape = pyramids["I"][4].shape
    sums = {}
    for name, levels in pyramids.items():
        sums[name] = np.zeros(shape)
        for c, d in itertools.product((2, 3, 4), (3, 4)):
            if c + d < len(levels):
                difference = abs(levels[c] - bilinear(levels[c + d], levels[c].shape))
                sums[name] += block_mean(normalize(difference, method), shape)
    intensity = sums["I"]
    color = normalize(sums["RG"], method) + normalize(sums["BY"], method)
    orientation = sum(normalize(sums[angle], method) for angle in (0, 45, 90, 135))
    saliency = sum(normalize(m, method) for m in (intensity, color, orientation)) / 3
    return saliency, intensity, color, orientation


def scanpath(saliency, fixations, sigma, limit=100_000):
    """The network in forward Euler steps of 0.1 ms: rows, columns and steps of its spikes.

    Constants in farad, siemens, volt and ampere; `sigma` in cells.
    """
    dt, C_map, leak_map, C_winner, leak_winner = 1e-4, 5e-8, 1e-7, 1e-9, 1e-8
    input_conductance, floor, threshold, answer = 5e-8, -0.02, 1e-3, 1e-2
    rows, columns = np.indices(saliency.shape)
    current = saliency * 1e-9 + 1e-14
    V, W, G = np.zeros((3, *saliency.shape))
    answers = {0}
    spikes = []
    for step in range(limit):
        V = np.maximum(0, V + dt / C_map * (current - (leak_map + G) * V))
        G = G * 0.9999
        inhibition = answer if step in answers else 0
        W = W + dt / C_winner * (input_conductance * V - leak_winner * W - inhibition * (W - floor))
        W = np.maximum(W, floor)
        over = threshold < W
        if over.any():
            column, row = np.argwhere(over.T)[0]
            d2 = (rows - row) ** 2 + (columns - column) ** 2
            disc = np.exp(-d2 / (2 * sigma**2)) - 1e-4 * np.exp(-d2 / (2 * (4 * sigma) ** 2))
            G = G + 0.1 * V[row, column] * disc
            W[over] = 0
            answers.add(step + 2)
            spikes.append((row, column, step))
            if len(spikes) == fixations:
                break
    return np.array(spikes).reshape(-1, 3).T


def advance_cell(V, W, g, current, leak, forget, decay, gain, steps):
    """One cell, step by step; over 1 per step it is at rest."""
    for _ in range(steps):
        rate = leak + g
        V = V * (1 - rate) + current if rate < 1 else current / rate
        W += forget * (gain * V - W)
        g *= 1 - decay
    return V, W


def gaussian(values, sigma):
    """Smoothed as far out as any weight counts, with the border mirrored."""
    return ndimage.gaussian_filter(values, sigma, mode="reflect", truncate=8)


def whitened(rgb):
    """CIE L*a*b* (1976, D65) of sRGB in principal components of unit variance, of at least 1."""
    rgb = np.asarray(rgb, float)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_xyz = [[0.412453, 0.35758, 0.180423], [0.212671, 0.71516, 0.072169]]
    to_xyz.append([0.019334, 0.119193, 0.950227])
    xyz = linear @ np.transpose(to_xyz) / (0.950456, 1.0, 1.088754)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(f, -1, 0)
    lab = np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
    points = lab.reshape(-1, 3) - lab.reshape(-1, 3).mean(0)
    _, singular, axes = np.linalg.svd(points, full_matrices=False)
    deviation = np.maximum(singular / np.sqrt(len(points)), 1)
    return (points @ axes.T / deviation).reshape(rgb.shape)


def surrounded(boolean_map):
    """The regions of ones, 8-connected, of which no pixel is on the border."""
    label, _ = ndimage.label(boolean_map, np.ones((3, 3)))
    frame = np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]])
    return (label > 0) & ~np.isin(label, frame)
