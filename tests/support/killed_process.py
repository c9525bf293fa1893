"""A block that kills its process; here, since the processes import it."""

import os
import signal

from saccade.batch.workers import BlockReport


def deadly(block):
    """Kills the process that works on the item 3."""
    if block[0].name == "3":
        os.kill(os.getpid(), signal.SIGKILL)
    return BlockReport(1, {})
