"""How well the defaults predict human fixations: OSIE, every fourth image."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade.attention import (
    ContrastConfig,
    SymmetryConfig,
    attention_saliency,
    contrast_saliency,
    symmetry_saliency,
)
from saccade.datasets.fixations import read_fixations
from saccade.evaluation.fixations import auc, correlation, fixation_density, nss, shuffled_auc

SHAPE = (600, 800)


@pytest.fixture(scope="module")
def osie(shared):
    """Pixels, places, their density and places of the other images, for every fourth image."""
    folder = shared / "data" / "eyes" / "osie"
    table = read_fixations(folder / "fixations.csv")
    later = table.index > 0  # the first was made before the image came
    names = sorted(set(table.image[later]), key=lambda name: int(name.split(".")[0]))
    assert len(names) == 140
    cases = []
    for name in names[::4]:
        pixels = cv2.imread(str(folder / "images" / name))[:, :, ::-1]
        assert pixels.shape == (*SHAPE, 3)
        own = table.image == name
        places = table.xy[later & own]
        density = fixation_density(places, SHAPE, 24.0)
        cases.append((pixels, places, density, table.xy[later & ~own]))
    return cases


@pytest.fixture(scope="module")
def default_scores(osie):
    return mean_scores(osie, lambda pixels: contrast_saliency(pixels).saliency)


def mean_scores(osie, predict):
    scores = []
    for pixels, places, density, others in osie:
        saliency = cv2.resize(predict(pixels), SHAPE[::-1], interpolation=cv2.INTER_LINEAR)
        scores.append(
            (
                auc(saliency, places),
                shuffled_auc(saliency, places, others),
                nss(saliency, places),
                correlation(saliency, density),
            )
        )
    return np.mean(scores, axis=0)


@pytest.mark.shared
def test_the_default_predicts_where_people_look(default_scores):
    assert (default_scores > (0.8, 0.76, 1.32, 0.4)).all(), default_scores


@pytest.mark.shared
def test_orientation_alone_is_above_chance(osie):
    scores = mean_scores(osie, lambda pixels: contrast_saliency(pixels).orientation)
    assert scores[0] > 0.62
    assert scores[1] > 0.55


@pytest.mark.nightly
@pytest.mark.shared
@pytest.mark.parametrize(
    "worse",
    [
        {"color": "quotient"},
        {"smoothing": 0.0},
        {"normalization": "iterative"},
        {"scales": ((2, 5), (3, 6), (4, 7))},
    ],
)
def test_rejected_options_are_worse(osie, default_scores, worse):
    config = replace(ContrastConfig(), **worse)
    scores = mean_scores(osie, lambda pixels: contrast_saliency(pixels, config).saliency)
    assert (scores < default_scores).all(), scores


@pytest.fixture(scope="module")
def symmetry_scores(osie):
    return mean_scores(osie, lambda pixels: symmetry_saliency(pixels).saliency)


@pytest.mark.nightly
@pytest.mark.shared
def test_symmetry_predicts_fixations_better_than_contrast(symmetry_scores, default_scores):
    assert (symmetry_scores > default_scores).all(), symmetry_scores


@pytest.mark.shared
def test_the_default_of_symmetry_predicts_where_people_look(symmetry_scores):
    assert (symmetry_scores > (0.82, 0.76, 1.6, 0.45)).all(), symmetry_scores


@pytest.mark.shared
def test_contrast_and_symmetry_together(osie, symmetry_scores):
    scores = mean_scores(osie, lambda pixels: attention_saliency(pixels).saliency)
    assert scores[0] > symmetry_scores[0]
    assert (scores > (0.83, 0.77, 1.6, 0.46)).all(), scores


@pytest.mark.nightly
@pytest.mark.shared
def test_fine_levels_are_what_the_source_lacks(osie, symmetry_scores):
    source = SymmetryConfig.kootstra2010()
    scores = mean_scores(osie, lambda pixels: symmetry_saliency(pixels, source).saliency)
    assert (scores < symmetry_scores - (0.03, 0.08, 0.3, 0.05)).all(), scores
