"""Threads and memory for the detectors."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from saccade.errors import require
from saccade.scale_space import Workspace


class WorkspacePool:
    """How many work at a time, and memory for as many calls as ran at a time.

    Args:
        threads: 0 for one to a core.
    """

    def __init__(self, threads: int) -> None:
        require(threads >= 0, "threads", "0 or more", threads)
        self.threads = threads or os.cpu_count() or 1
        self._spare = [Workspace()]

    @contextmanager
    def workspace(self) -> Iterator[Workspace]:
        """Memory that no other call uses meanwhile; the next has it again."""
        try:
            workspace = self._spare.pop()
        except IndexError:  # not asked before: another thread may take the last meanwhile
            workspace = Workspace()
        try:
            yield workspace
        finally:
            self._spare.append(workspace)
