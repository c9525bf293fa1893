"""What covers a winner: the region that made it win."""

from functools import partial

import numpy as np
import pytest

from saccade.attention import (
    ContrastConfig,
    ContrastMaps,
    FeatureMap,
    ScanpathConfig,
    contrast_saliency,
    proto_object,
    scanpath,
)
from saccade.attention.channels import Channel
from saccade.attention.scanpath import region_around
from saccade.errors import ImageError

INTENSITY = Channel("intensity")


def maps_with(feature, channel=INTENSITY, conspicuity="intensity"):
    flat = np.zeros_like(feature)
    maps = dict.fromkeys(("intensity", "color", "orientation"), flat)
    maps[conspicuity] = feature
    weaker = FeatureMap(channel, 1, 2, feature / 2, np.roll(feature, 5, axis=1) / 2)
    stronger = FeatureMap(channel, 1, 3, feature, feature)
    elsewhere = FeatureMap(Channel("orientation", 45.0), 1, 3, 9 * feature.T, 9 * feature.T)
    return ContrastMaps(feature, (400, 400), **maps, features=(weaker, elsewhere, stronger))


def test_a_region_is_what_is_connected_to_the_winner_and_a_margin():
    values = np.zeros((40, 40))
    values[10:13, 10:13] = 1
    values[12, 13] = 0.06
    values[11, 13] = 0.04
    values[13, 14] = 1  # touches at a corner only
    values[30, 30] = 1
    region = region_around(values, 11, 11)
    rows, columns = np.nonzero(region)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (8, 14, 8, 15)
    assert not region[8, 8]  # the margin is a disc
    assert not region[30, 30]


def test_no_region_of_nothing_and_none_of_everything():
    assert region_around(np.zeros((9, 9)), 4, 4) is None
    assert region_around(np.ones((9, 9)), 4, 4) is None


def test_a_region_is_cut_higher_until_it_is_small():
    y, x = np.mgrid[:40, :40] - 20
    region = region_around(np.exp(-(x**2 + y**2) / 200), 20, 20)
    assert 0 < region.sum() < 0.2 * region.size
    assert region[20, 20]
    assert not region[20, 36]


@pytest.mark.parametrize(
    ("channel", "conspicuity"),
    [
        (INTENSITY, "intensity"),
        (Channel("red-green"), "color"),
        (Channel("orientation", 0.0), "orientation"),
    ],
)
def test_the_strongest_feature_of_the_strongest_map_is_taken(channel, conspicuity):
    feature = np.zeros((40, 40))
    feature[20:24, 8:12] = 1
    maps = maps_with(feature, channel, conspicuity)
    expected = region_around(maps.features[-1].values, 21, 9)
    np.testing.assert_array_equal(proto_object(maps, 21, 9), expected)


def test_what_cannot_be_answered_is_refused():
    feature = np.ones((10, 10))
    for row, column in ((10, 3), (12, 3), (-1, 3), (3, 10), (3, 12), (3, -1)):
        with pytest.raises(ImageError, match=f"of 10 x 10, found {row}, {column}"):
            proto_object(maps_with(feature), row, column)
    featureless = ContrastMaps(feature, (100, 100), feature, feature, feature)
    with pytest.raises(ImageError, match="keep_features"):
        proto_object(featureless, 1, 1)


def test_a_scanpath_leaves_the_whole_object_and_not_just_a_disc():
    image = np.full((240, 320, 3), 90, np.uint8)
    image[60:180, 60:72] = 250  # one long bar
    image[110:122, 250:262] = 240  # and a spot
    maps = contrast_saliency(image, ContrastConfig.kootstra2010(), keep_features=True)
    disc = ScanpathConfig(inhibition_sigma=0.025)
    by_disc = scanpath(maps, disc, fixations=3)
    by_shape = scanpath(maps, disc, fixations=3, region=partial(proto_object, maps))
    assert (by_disc.xy[:, 0] < 100).all()
    np.testing.assert_array_equal(by_shape.xy[0], by_disc.xy[0])
    assert by_shape.xy[1, 0] > 240
