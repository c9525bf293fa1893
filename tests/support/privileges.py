"""Taking from a process what lets an administrator ignore permissions."""

import ctypes

DROP_FROM_BOUNDING_SET = 24
MAY_WRITE_ANYWHERE, MAY_READ_ANYWHERE = 1, 2
"""Of Linux: what lets an administrator ignore permissions, and the call that takes it away."""


def without_privileges():
    """Let permissions count for an administrator too, as whom containers run tests."""
    for each in (MAY_WRITE_ANYWHERE, MAY_READ_ANYWHERE):
        ctypes.CDLL(None).prctl(DROP_FROM_BOUNDING_SET, each, 0, 0, 0)
