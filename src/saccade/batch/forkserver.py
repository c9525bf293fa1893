"""Starts the process that workers are forked from, where the system has forkservers.

It imports the libraries of all workers once, while the main process does so too: import nothing
heavy here. Number of threads and signals are set in worker processes only.
"""

import multiprocessing
import os
import signal
import threading
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess

FORKSERVER = "forkserver"


def worker_context(*modules: str) -> BaseContext:
    """The context that starts workers; begins to load their libraries.

    Args:
        modules: to import besides, such as the one that the program was started with.
    """
    if FORKSERVER not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver

    context = multiprocessing.get_context(FORKSERVER)
    context.set_forkserver_preload(["saccade.batch.preload", *modules])
    forkserver.ensure_running()
    return context


def limit_blas_threads() -> None:
    """Let BLAS use one thread in this worker: there is a process for every core.

    Takes effect if NumPy is not loaded yet.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def initialize_worker() -> None:
    """Initializer of a worker: one thread, no Ctrl-C, and it exits when its parent does."""
    limit_blas_threads()
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _exit_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
