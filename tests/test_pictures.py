"""Results show themselves in a notebook."""

import base64
import re

import cv2
import numpy as np
import pytest

import saccade
from saccade.slam import run
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
