"""A block that kills its process; here, since the processes import it."""

import os
import signal


def deadly(block):
    """Kills the process that works on block 3."""
    if block == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * block
