"""A shard that kills its process; here, since the processes import what it comes from."""

import os
import signal

from saccade.batch.engines import Shard, ShardReport


def deadly(shard: Shard) -> ShardReport:
    """What kills the process that works on the fourth shard."""
    if shard.name == "3":
        os.kill(os.getpid(), signal.SIGKILL)
    return ShardReport(done=1, unchanged=int(shard.name))
