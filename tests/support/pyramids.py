"""A whole pyramid, of levels that the models make one by one."""

from saccade.scale.pyramid import deepest_level, halve


def dyadic_pyramid(image, levels):
    """Level 0, the image, to level `levels`, or to the coarsest."""
    pyramid = [image]
    for _ in range(min(levels, deepest_level(image.shape))):
        pyramid.append(halve(pyramid[-1]))
    return pyramid
