"""Whether a file is a picture of something."""

import cv2


def looks_like_a_picture(path):
    picture = cv2.imread(str(path))
    return picture is not None and min(picture.shape[:2]) > 200 and picture.std() > 10
