"""What the tests of the textbook share."""

import pytest

from saccade.textbook import sift
from support.gray_scenes import scene


@pytest.fixture(scope="session")
def found():
    """What SIFT finds in a scene of blobs."""
    return sift(scene())
