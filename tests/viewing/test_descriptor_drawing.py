"""Descriptors are drawn the way the gradients point: held to ramps, whose direction is known."""

from importlib.resources import files

import numpy as np

from saccade import Keypoints, Sift, SiftConfig

RAMPS = [(0, 0), (30, 0), (90, 0), (-120, 0), (70, 25), (-50, -160)]
"""Degrees from x towards y: the gradient of the image, and the angle of the point."""


def described(gradient, angle):
    """(128,) of a point in the middle of a ramp that gets lighter along the gradient."""
    row, column = np.indices((161, 161)) / 160 - 0.5
    direction = np.radians(gradient)
    image = 0.5 + 0.5 * (np.cos(direction) * column + np.sin(direction) * row)
    point = Keypoints.at([[80, 80]], size=8, angle=np.radians(angle))
    return Sift(SiftConfig(descriptor="sift")).describe(image, point).descriptors[0]


def assert_along(rays, gradient, angle):
    """That 128 rays, each x, y of both its ends, point along the gradient in the point's frame."""
    rays = np.reshape(rays, (4, 4, 8, 2, 2))
    np.testing.assert_allclose(rays[:, :, 0, 0, 0], np.tile([10, 30, 50, 70], (4, 1)))
    np.testing.assert_allclose(rays[:, :, 0, 0, 1], np.tile([[10], [30], [50], [70]], 4))
    x, y = (rays[..., 1, :] - rays[..., 0, :]).sum(axis=(0, 1, 2))
    off = np.degrees(np.arctan2(y, x)) - (gradient - angle)  # y points down in both
    assert abs((off + 180) % 360 - 180) < 3


def test_in_the_report(browser):
    script = (files("saccade") / "viewing" / "web" / "image.js").read_text(encoding="utf-8")
    page = browser.new_page()
    page.add_script_tag(content="const kinds = {};\n" + script)
    for ramp in RAMPS:
        values = described(*ramp).tolist()
        assert_along(page.evaluate("values => descriptorRays(values, 20)", values), *ramp)
    page.close()
