"""A Dask scheduler and two workers, each a process of its own, forked from one that is loaded."""

import asyncio
import os
import signal
import sys
from pathlib import Path

import distributed

from support.extraction import extract_here, photographs


async def schedule(file):
    """Run a scheduler, and write its address to a file."""
    async with distributed.Scheduler(host="127.0.0.1", port=0, dashboard_address=":0") as scheduler:
        Path(f"{file}.new").write_text(scheduler.address)
        Path(f"{file}.new").rename(file)
        await scheduler.finished()


async def work(address, folder):
    """Run a worker until it is killed."""
    async with distributed.Worker(address, nthreads=1, local_directory=folder) as worker:
        await worker.finished()


def forked(main):
    """The number of a process that runs a coroutine."""
    child = os.fork()
    if child == 0:
        asyncio.run(main)
        os._exit(0)
    main.close()
    return child


def start(folder):
    """Run all three until this process is told to end; gives the numbers of the workers first."""
    photographs(folder / "before", 1)
    extract_here(folder / "before", folder / "loaded")
    file = folder / "address"
    children = [forked(schedule(file))]
    while not file.exists():
        signal.sigtimedwait([], 0.01)
    children += [forked(work(file.read_text(), folder)) for _ in range(2)]
    print(file.read_text(), *children[1:], flush=True)
    sys.stdin.read()
    for child in children:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


if __name__ == "__main__":
    start(Path(sys.argv[1]))
