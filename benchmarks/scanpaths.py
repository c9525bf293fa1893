"""Scanpaths: the fit of the model, and its scores (docs/scanpaths.md, docs/measured.md).

    uv run python benchmarks/scanpaths.py IMAGES FIXATIONS            scores on half B
    uv run python benchmarks/scanpaths.py IMAGES FIXATIONS --fit      the parameters, on half A

The images, sorted by number, are split alternately: half A (1st, 3rd, ...) develops, half B (2nd,
4th, ...) reports. The fit maximizes the likelihood of every fourth path (L-BFGS from two starting
points, of which one has a wide inhibition) and prints the gain over a uniform distribution on both
halves. The scores are those of `saccade evaluate scanpaths`.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.stats import gamma

from measuring import arguments
from saccade import AttentionConfig, ScanpathModelConfig, attention_saliency
from saccade.attention import (
    SaliencyMaps,
    scanpath_log_likelihood,
)
from saccade.datasets.fixations import read_fixations
from saccade.evaluation.conditional import score_fixations, summary
from saccade.evaluation.prediction import FixationData
from saccade.evaluation.scanpaths import (
    PathSettings,
    ScanMatchConfig,
    Viewing,
    mean_fixations,
    score_paths,
    viewings,
)
from saccade.io.image import read_image

DEGREE = 24.0
"""Pixels per degree of visual angle."""
EVERY = 4
"""One of so many paths of half A is fitted."""
STARTS = (
    ScanpathModelConfig(
        exponent=1.0,
        floor=0.002,
        center_sigma=0.4,
        amplitude_scale=0.005,
        amplitude_exponent=0.5,
        horizontal=0.2,
        persistence=0.36,
        inhibition=0.27,
        inhibition_sigma=0.1,
        inhibition_decay=0.8,
    ),
    ScanpathModelConfig(
        exponent=1.2,
        floor=0.05,
        center_sigma=0.45,
        amplitude_scale=0.08,
        amplitude_exponent=1.2,
        horizontal=0.1,
        persistence=0.0,
        inhibition=0.5,
        inhibition_sigma=0.03,
        inhibition_decay=0.5,
    ),
)
Transform = tuple[Callable[[float], float], Callable[[float], float]]
POSITIVE: Transform = (np.log, np.exp)
SIGNED: Transform = (np.arctanh, np.tanh)
FRACTION: Transform = (lambda p: np.log(p / (1 - p)), lambda t: 0.999 / (1 + np.exp(-t)))
PARAMETERS: dict[str, Transform] = {
    "exponent": POSITIVE,
    "floor": POSITIVE,
    "center_sigma": POSITIVE,
    "amplitude_scale": POSITIVE,
    "amplitude_exponent": POSITIVE,
    "horizontal": SIGNED,
    "persistence": SIGNED,
    "inhibition": FRACTION,
    "inhibition_sigma": POSITIVE,
    "inhibition_decay": FRACTION,
}
"""How each is made unbounded, and back."""
Maps = Mapping[str, np.ndarray]


def gain(
    people: Mapping[str, Viewing], maps: Maps, config: ScanpathModelConfig, every: int
) -> float:
    """Mean log-likelihood of the fixations over a uniform distribution, in bits."""
    logs, number = [], 0
    for name, (shape, paths) in people.items():
        for path in paths.values():
            number += 1
            if number % every == 0:
                found = scanpath_log_likelihood(SaliencyMaps(maps[name], shape), path.xy, config)
                logs.append(found + np.log(shape[0] * shape[1]))
    return float(np.concatenate(logs).mean() / np.log(2))


def fit(people: Mapping[str, Viewing], maps: Maps) -> ScanpathModelConfig:
    """The parameters of the greatest likelihood."""

    def config(unbounded: np.ndarray) -> ScanpathModelConfig:
        values = zip(PARAMETERS.items(), unbounded, strict=True)
        return ScanpathModelConfig(**{name: float(back(t)) for (name, (_, back)), t in values})

    found = []
    for start in STARTS:
        unbounded = [forth(getattr(start, name)) for name, (forth, _) in PARAMETERS.items()]
        result = minimize(
            lambda t: -gain(people, maps, config(t), EVERY),
            unbounded,
            method="L-BFGS-B",
            options={"maxiter": 40, "maxfun": 600, "eps": 1e-4},
        )
        print(f"from {start}\n  {-result.fun:.4f} bits: {config(result.x)}", flush=True)
        found.append(result)
    return config(min(found, key=lambda result: result.fun).x)


def fit_durations(people: Mapping[str, Viewing]) -> tuple[float, float]:
    """Mean and shape of the gamma distribution of the greatest likelihood."""
    seconds = [path.duration for viewing in people.values() for path in viewing.paths.values()]
    shape, _, scale = gamma.fit(np.concatenate(seconds), floc=0)
    return shape * scale, shape


def report(people: Mapping[str, Viewing], maps: Maps, title: str, grid: ScanMatchConfig) -> None:
    """Print the scores of `saccade evaluate scanpaths`."""
    settings = PathSettings(mean_fixations(people), similarity=grid)
    rows = [row for name in people for row in score_paths(name, people, maps[name], settings)]
    show(f"{title}, {grid.columns} x {grid.rows} cells", summary(rows))


def show(title: str, scores: Mapping[str, Mapping[str, tuple[float, float, float]]]) -> None:
    """Print means with their intervals."""
    print(f"\n{title}")
    for name, values in scores.items():
        scale = {"amplitude": 1 / DEGREE, "seconds": 1000.0}
        cells = (
            f"{key} {' '.join(f'{scale.get(key, 1) * each:.3f}' for each in value)}"
            for key, value in values.items()
        )
        print(f"  {name:22} {'; '.join(cells)}")


def main() -> None:
    options = arguments(
        __doc__,
        images={"flags": "images", "type": Path},
        fixations={"flags": "fixations", "type": Path},
        fit={"action": "store_true", "help": "fit the parameters on half A"},
    )
    table = read_fixations(options.fixations)
    names = sorted(np.unique(table.image).tolist(), key=lambda name: (len(name), name))
    parts = [table[np.isin(table.image, names[k::2])] for k in (0, 1)]
    data = [FixationData.of(part, options.images, 1, DEGREE) for part in parts]
    halves = [viewings(each) for each in data]

    def maps_of(people: Mapping[str, Viewing], config: AttentionConfig | None = None) -> Maps:
        return {
            name: attention_saliency(read_image(options.images / name), config).saliency
            for name in people
        }

    if options.fit:
        maps = [maps_of(half) for half in halves]
        mean, shape = fit_durations(halves[0])
        config = replace(fit(halves[0], maps[0]), duration_mean=mean, duration_shape=shape)
        gains = [gain(half, each, config, 1) for half, each in zip(halves, maps, strict=True)]
        print(f"{config}\nhalf A {gains[0]:.3f}, half B {gains[1]:.3f} bits over uniform")
        return
    people = halves[1]
    for title, config in (("default", None), ("free_viewing", AttentionConfig.free_viewing())):
        maps = maps_of(people, config)
        for grid in (ScanMatchConfig(), ScanMatchConfig(columns=8, rows=6)):
            report(people, maps, f"half B, {title}", grid)
        rows = [
            row
            for name in people
            for row in score_fixations(name, data[1], maps[name], ScanpathModelConfig())
        ]
        show(f"half B, {title}: each next fixation", summary(rows))


if __name__ == "__main__":
    main()
