"""Scores of scanpaths and of the prediction of each fixation, on people who are simulated."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from saccade.attention import SaliencyMaps, ScanpathModelConfig, sample_scanpaths
from saccade.evaluation.conditional import MODELS, score_fixations, summary
from saccade.evaluation.fixations import auc, nss
from saccade.evaluation.prediction import FixationData
from saccade.evaluation.scanpaths import SOURCES, PathSettings, score_paths, viewings
from saccade.types import FixationTable

SHAPE = (300, 400)
MODEL = ScanpathModelConfig(exponent=1.0, center_sigma=None, inhibition=0.3)


@pytest.fixture(scope="module")
def seen():
    """Maps of two images, and ten people each whose paths are drawn from the model."""
    rng = np.random.default_rng(8)
    maps, rows = {}, []
    for image in ("a.png", "b.png"):
        maps[image] = np.zeros((18, 24), np.float32)
        maps[image][rng.integers(0, 18, 3), rng.integers(0, 24, 3)] = 1
        maps[image] = cv2.GaussianBlur(maps[image], (0, 0), 1.5)
        values = SaliencyMaps(maps[image], SHAPE)
        people = sample_scanpaths(values, MODEL, count=10, fixations=8, seed=len(rows))
        for subject in range(10):
            for k in range(8):
                xy, seconds = people.xy[subject, k], people.duration[subject, k]
                rows.append((image, subject, k, *np.clip(xy, 0, (399, 299)), seconds))
    image, subject, index, x, y, seconds = zip(*rows, strict=True)
    table = FixationTable(
        np.array(image), np.array(subject), np.array(index), np.stack([x, y], 1), np.array(seconds)
    )
    return maps, table


def test_who_is_drawn_from_a_model_is_like_its_samples_and_best_predicted_by_it(seen):
    maps, table = seen
    data = FixationData(Path(), table, dict.fromkeys(maps, SHAPE), 10.0)
    people = viewings(data)
    settings = PathSettings(8, 20, MODEL)
    paths = summary(
        [row for name in maps for row in score_paths(name, people, maps[name], settings)]
    )
    assert set(paths) == set(SOURCES)
    similarity = {name: scores["scanmatch"].mean for name, scores in paths.items()}
    assert similarity["sampled"] == pytest.approx(similarity["people"], abs=0.05)
    assert similarity["other images"] < similarity["people"] - 0.03
    assert similarity["centered walk"] < similarity["people"] - 0.03
    length = {name: scores["amplitude"].mean for name, scores in paths.items()}
    assert length["sampled"] == pytest.approx(length["people"], rel=0.15)
    predicted = summary(
        [row for name in maps for row in score_fixations(name, data, maps[name], MODEL)]
    )
    assert set(predicted) == set(MODELS)
    gains = {
        name: scores["information_gain"].mean
        for name, scores in predicted.items()
        if "information_gain" in scores
    }
    assert max(gains, key=gains.get) == "sampled"
    assert gains["other images"] == 0
    assert predicted["sampled"]["nss"].mean > predicted["saliency map"]["nss"].mean


def test_scores_of_the_map_are_those_of_fixation_prediction(seen):
    maps, table = seen
    data = FixationData(Path(), table, dict.fromkeys(maps, SHAPE), 10.0)
    rows = list(score_fixations("a.png", data, maps["a.png"], MODEL))
    cells = (table.xy[:80] + 0.5) / SHAPE[::-1] * (24, 18) - 0.5
    scores = [row.scores for row in rows if row.model == "saliency map"]
    assert np.mean([each.nss for each in scores]) == pytest.approx(nss(maps["a.png"], cells))
    assert np.mean([each.auc for each in scores]) == pytest.approx(auc(maps["a.png"], cells))
    assert all(np.isnan(each.information_gain) for each in scores)
