"""A run that somebody stops; as a program it is `saccade` with a signal to itself before the rest.

The signal comes as soon as a checkpoint is there.
"""

import os
import signal
import sys

from saccade.cli import main
from saccade.slam import Checkpoint


def interrupt_at(pose):
    def progress(done, total):
        if done >= pose:
            raise KeyboardInterrupt

    return progress


def stop_once_saved(how):
    """Let this process get a signal as soon as a run in it has saved itself."""
    keep = Checkpoint.save

    def keep_and_stop(checkpoint, step, state):
        keep(checkpoint, step, state)
        if checkpoint.path.exists():
            os.kill(os.getpid(), how)

    Checkpoint.save = keep_and_stop


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background ignores it
    stop_once_saved(int(sys.argv.pop(1)))
    main()
