"""Detectors and saliency as users bring them."""

from types import SimpleNamespace

import cv2
import numpy as np

import saccade


def corner_detector(settings, threads=None):
    """OpenCV's Harris corners, which have no descriptors, as a detector of the table."""

    def detect(image, mask=None):
        return corners(image)[: settings.max_keypoints]

    return detect


def corners(image):
    """A user's detector of corners, without descriptors."""
    gray = np.asarray(image, np.float32).mean(axis=2)
    xy = cv2.goodFeaturesToTrack(gray, 40, 0.01, 5, useHarrisDetector=True)
    return saccade.Keypoints.at(xy.reshape(-1, 2), 6)


def gray_patches(image):
    """A user's detector with descriptors of its own, no keypoints of ours."""
    gray = np.asarray(image, np.float32).mean(axis=2)
    xy = np.rint(corners(image).xy).clip(4, np.array(gray.shape[::-1]) - 5).astype(int)
    rows = [(gray[y - 4 : y + 5, x - 4 : x + 5] - gray[y, x]).ravel() for x, y in xy]
    return SimpleNamespace(xy=xy.astype(float), descriptors=np.array(rows))


def brightness(image):
    """A user's saliency."""
    return np.asarray(image).mean(axis=2)[::4, ::4]


def fails(image):
    raise RuntimeError("no luck")
