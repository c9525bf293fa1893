"""What workers need, loaded where they are forked from; nothing else imports this.

Most of it is what Numba loads at the first call of a kernel.
"""

import signal
from contextlib import suppress

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one that hands out the work

with suppress(Exception):  # it fails again where the work is handed out, and is told there
    import cv2
    import numpy as np

    import saccade.batch.shards  # noqa: F401
    from saccade.batch.analysis import analysis
    from saccade.batch.job import Job
    from saccade.keypoints.sift_config import SiftConfig

    cv2.setNumThreads(1)  # no threads are left behind by a fork
    analysis(Job("sift", SiftConfig()))("", np.zeros((64, 64), np.uint8))
