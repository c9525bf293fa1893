"""How well the defaults predict human fixations: OSIE, every fourth image."""

import cv2
import numpy as np
import pytest

from saccade.attention import (
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
@pytest.mark.parametrize(
    ("predict", "least"),
    [
        (lambda pixels: contrast_saliency(pixels).saliency, (0.8, 0.76, 1.32, 0.4)),
        (lambda pixels: contrast_saliency(pixels).orientation, (0.62, 0.55, 0, 0)),
        (lambda pixels: symmetry_saliency(pixels).saliency, (0.82, 0.76, 1.6, 0.45)),
        (lambda pixels: attention_saliency(pixels).saliency, (0.83, 0.77, 1.6, 0.46)),
    ],
    ids=["contrast", "orientation", "symmetry", "attention"],
)
def test_where_people_look_is_predicted(osie, predict, least):
    scores = mean_scores(osie, predict)
    assert (scores > least).all(), scores
