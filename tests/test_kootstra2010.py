"""The presets of the source against the textbook, which is written from the print alone."""

import numpy as np
import pytest

from conftest import REFERENCE_IMAGES
from saccade import ContrastConfig, contrast_saliency, read_image
from saccade.textbook.contrast_saliency import contrast_saliency as printed_saliency

MAPS = ("saliency", "intensity", "color", "orientation")


def correlation(a, b):
    """Of two maps; 1 where both are flat."""
    return 1.0 if np.ptp(a) == np.ptp(b) == 0 else np.corrcoef(a.ravel(), b.ravel())[0, 1]


@pytest.mark.shared
@pytest.mark.parametrize("name", REFERENCE_IMAGES)
def test_contrast_maps(shared, name):
    image = read_image(shared / "reference" / "saliency" / "images" / f"{name}.png")
    found = contrast_saliency(image, ContrastConfig.kootstra2010())
    printed = printed_saliency(image)
    for each in MAPS:
        agreement = correlation(getattr(found, each), getattr(printed, each))
        print(f"\n{name} {each}: {agreement:.5f}", end="")
        assert agreement >= 0.999, each
