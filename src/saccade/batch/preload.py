"""Imports what workers need in the process they are forked from; nothing else imports this.

Most of the time goes into what Numba loads at the first call of a kernel.
"""

import signal
from contextlib import suppress

from saccade.batch.engines import limit_blas_threads

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the main process
limit_blas_threads()

with suppress(Exception):  # the same error is raised, and reported, in the main process
    import cv2
    import numpy as np

    from saccade.batch.job import Job
    from saccade.batch.shards import analyzer
    from saccade.keypoints.sift_config import SiftConfig

    cv2.setNumThreads(1)  # a fork must not find the threads of a pool gone
    analyzer(Job("sift", SiftConfig()))(np.zeros((64, 64), np.uint8))
