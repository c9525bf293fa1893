"""The process that workers are forked from, where the system has that: it loads once for all.

It loads while the one that hands out the work does so too: import nothing heavy here.
"""

import multiprocessing
import os
from multiprocessing.context import BaseContext

FORKSERVER = "forkserver"


def begin_loading(*modules: str) -> BaseContext:
    """Let what all workers need be loaded in another process, unless that has begun.

    Args:
        modules: to be loaded besides, such as the one that the program was started with.

    Returns:
        What workers are started by.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # a process to a core is what is wanted
    if FORKSERVER not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver

    context = multiprocessing.get_context(FORKSERVER)
    context.set_forkserver_preload(["saccade.batch.preload", *modules])
    forkserver.ensure_running()
    return context
