"""What workers need, loaded where they are forked from; nothing else imports this.

Most of it is what Numba loads at the first call of a kernel.
"""

import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one that hands out the work

import cv2  # noqa: E402
import numpy as np  # noqa: E402

import saccade.batch.shards  # noqa: E402, F401
from saccade.batch.analysis import analysis  # noqa: E402
from saccade.batch.job import Job  # noqa: E402
from saccade.keypoints.sift_config import SiftConfig  # noqa: E402

cv2.setNumThreads(1)  # no threads are left behind by a fork
analysis(Job("sift", SiftConfig()))("", np.zeros((64, 64), np.uint8))
