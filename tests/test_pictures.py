"""Results show themselves in a notebook."""

import base64
import re

import cv2
import numpy as np
import pytest

import saccade
from saccade.pictures import result_figure
from saccade.slam import run
from saccade.types import FixationTable
from saccade.viewing.attention import apart
from support.circular_log import simulate
from support.processes import run_python
from support.saliency_images import noise

RESULTS = {
    "attention": lambda: saccade.attention_saliency(noise(1, (60, 90))),
    "contrast": lambda: saccade.contrast_saliency(noise(1, (60, 90))),
    "flat": lambda: saccade.contrast_saliency(np.zeros((60, 90))),
    "keypoints": lambda: saccade.Sift()(noise(1, (60, 90))),
    "no keypoints": lambda: saccade.Sift()(np.zeros((60, 90))),
    "slam": lambda: run(simulate(np.random.default_rng(1), steps=40)[0]),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_a_picture_in_a_notebook(name):
    result = RESULTS[name]()
    (alt, data) = re.fullmatch(
        r'<img alt="([^"<>]+)" src="data:image/png;base64,([^"]+)">', result._repr_html_()
    ).groups()
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    assert picture.std() > 1
    assert alt.startswith(type(result).__name__)


def test_a_result_loads_what_draws_it_when_it_is_shown():
    code = """
import sys, numpy as np, saccade
maps = saccade.contrast_saliency(np.zeros((60, 90)))
before = "matplotlib" in sys.modules
maps._repr_html_()
print(before, "matplotlib" in sys.modules)
"""
    assert run_python("-c", code, check=True).stdout.split() == ["False", "True"]


def test_fixations_are_drawn_with_their_density_beside_the_maps():
    image, xy = noise(1, (60, 90)), np.array([[20.0, 30.0], [21.0, 30.0], [200.0, 5.0]])
    maps = saccade.contrast_saliency(image)
    figure = result_figure(image, maps, fixations=xy, sigma=4.0, dpi=50)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[1:3] == ["3 fixations, blurred by 4 px", "saliency"]
    density = figure.axes[1].images[0].get_array()
    assert np.unravel_index(density.argmax(), density.shape)[0] == 30
    assert density.sum() == pytest.approx(2, abs=0.01)
    assert figure.dpi == 50
    assert len(figure.axes) == 3 * 3 + 5  # each map has a color bar
    table = FixationTable(np.array(["a", "a", "b"]), np.zeros(3, int), np.arange(3), xy)
    assert len(result_figure(image, fixations=table[:2]).axes) > 1
    with pytest.raises(saccade.ConfigError, match="fixations: expected those on one image"):
        result_figure(image, fixations=table)


@pytest.mark.parametrize("spread", [0, 1, 20])
@pytest.mark.parametrize("center", [(0, 0), (45, 30), (90, 60)])
def test_labels_of_fixations_do_not_hide_each_other(center, spread, rng):
    xy = (center + spread * rng.normal(size=(7, 2))).clip(0, (90, 60))
    placed = apart(xy, np.full(7, 5.0), np.array([90.0, 60.0]))
    distance = np.hypot(*np.moveaxis(placed[:, None] - placed, 2, 0)) + 100 * np.eye(7)
    assert distance.min() > 8
    assert (placed >= 0).all()
    assert (placed <= (90, 60)).all()
