"""Engines that run shards: this process, processes on this machine, or a Dask cluster."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from typing import Any, Protocol, TypeAlias, TypeVar

from saccade.batch.shards import ShardReport
from saccade.batch.workers import initialize_worker, worker_context
from saccade.errors import ConfigError
from saccade.extras import import_optional

QUEUED = 2
"""Shards submitted per worker, so that none waits for the main process."""
DIED = "the process that worked on it died; was there enough memory?"
BATCH_SYSTEMS = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "htcondor": "HTCondorCluster",
    "oar": "OARCluster",
}
"""Names of batch systems, and their classes in dask-jobqueue."""
JOB_DEFAULTS = {"cores": 1, "memory": "2GB"}
"""Resources of a job, unless the configuration of dask-jobqueue sets them."""
TIMEOUT = 20.0
"""Seconds in which a scheduler must answer."""


class Named(Protocol):
    """An image, or a pair of images."""

    @property
    def name(self) -> str:
        """Name in reports."""


class Batch(Protocol):
    """Work of one worker at a time: a shard of images, or of pairs."""

    @property
    def items(self) -> Sequence[Named]:
        """Images or pairs in it."""


Shard = TypeVar("Shard", bound=Batch)
Work: TypeAlias = Callable[[Shard], ShardReport]


class Engine(Protocol):
    """Runs shards in any order, several at a time."""

    def run(self, work: Work[Shard], shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """The report of every shard; takes the next shard only when a worker is free for it."""


class InProcess:
    """One shard after the other, in this process.

    While a shard is processed OpenCV uses one thread; its setting is restored after each.
    """

    def run(self, work: Work[Shard], shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`."""
        for shard in shards:
            with _one_opencv_thread():
                report = work(shard)
            yield report


class Processes:
    """Processes on this machine.

    Args:
        workers: how many.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers

    def run(self, work: Work[Shard], shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`. A shard that kills its process is retried once, alone."""
        finished = False
        while not finished:
            suspects = []
            pool = _start_pool(self._workers)
            try:
                for shard, future in _run_on(pool, work, shards, lambda: self._workers):
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        suspects.append(shard)
            finally:
                pool.shutdown(cancel_futures=True)
            yield from _run_alone(work, suspects)
            finished = not suspects


class DaskEngine:
    """Runs shards on the workers of a Dask cluster, which must see the same files.

    Args:
        client: a `distributed.Client`.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def run(self, work: Work[Shard], shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`. Dask reruns the shards of a worker that died on another."""
        executor = self._client.get_executor(pure=False)
        for shard, future in _run_on(executor, work, shards, self._count_threads):
            failure = future.exception()
            yield future.result() if failure is None else _lost_shard(shard, str(failure))

    def _count_threads(self) -> int:
        """Number of threads of all workers, which may come and go."""
        return sum(self._client.nthreads().values())


@contextmanager
def connect(address: str) -> Iterator[DaskEngine]:
    """The workers of a running scheduler.

    Args:
        address: such as tcp://host:8786.

    Raises:
        ConfigError: Dask is not installed, or no scheduler answers.
    """
    distributed = import_optional("distributed", "cluster")
    try:
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"scheduler: expected one at {address}, found none: {error}") from error
    with client:
        yield DaskEngine(client)


@contextmanager
def submit_jobs(system: str, jobs: int) -> Iterator[DaskEngine]:
    """Workers in jobs of a batch system, configured by the file of dask-jobqueue.

    Args:
        system: one of `BATCH_SYSTEMS`.
        jobs: how many to submit; work starts with the first.

    Raises:
        ConfigError: the system is unknown, dask-jobqueue is not installed, or its configuration
            is incomplete.
    """
    if system not in BATCH_SYSTEMS:
        raise ConfigError(f"cluster: expected one of {', '.join(BATCH_SYSTEMS)}, found {system!r}")
    jobqueue = import_optional("dask_jobqueue", "cluster")
    dask = import_optional("dask", "cluster")
    distributed = import_optional("distributed", "cluster")
    with ExitStack() as stack:
        configured = dask.config.get(f"jobqueue.{system}", {})
        resources = {k: value for k, value in JOB_DEFAULTS.items() if configured.get(k) is None}
        try:
            cluster = stack.enter_context(getattr(jobqueue, BATCH_SYSTEMS[system])(**resources))
            cluster.scale(jobs=jobs)
        except (OSError, RuntimeError, ValueError) as error:
            raise ConfigError(f"cluster: {system} cannot be used: {error}") from error
        client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
        client.wait_for_workers(1)
        yield DaskEngine(client)


def _run_on(
    executor: Executor,
    work: Work[Shard],
    shards: Iterator[Shard],
    workers: Callable[[], int],
) -> Iterator[tuple[Shard, Future[ShardReport]]]:
    """Run shards on an executor, and give each with its future when it is done.

    Takes no further shard once the executor is broken.

    Args:
        executor: runs the work.
        work: to do for a shard.
        shards: taken from only as workers become free.
        workers: current number of workers of the executor.
    """
    running: dict[Future[ShardReport], Shard] = {}
    accepting = True
    while accepting or running:
        while accepting and len(running) < QUEUED * max(workers(), 1):
            shard = next(shards, None)
            accepting = shard is not None
            if shard is not None:
                running[_submit(executor, work, shard)] = shard
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            accepting = accepting and not isinstance(future.exception(), BrokenExecutor)
            yield running.pop(future), future


def _submit(executor: Executor, work: Work[Shard], shard: Shard) -> Future[ShardReport]:
    """A future, which has failed where the executor is broken already."""
    try:
        return executor.submit(work, shard)
    except BrokenExecutor as error:
        future: Future[ShardReport] = Future()
        future.set_exception(error)
        return future


def _lost_shard(shard: Batch, reason: str) -> ShardReport:
    """The report of a shard without results."""
    return ShardReport(lost=[(item.name, reason) for item in shard.items])


def _run_alone(work: Work[Shard], shards: list[Shard]) -> Iterator[ShardReport]:
    """Each shard in a process of its own."""
    for shard in shards:
        with _start_pool(1) as pool:
            try:
                yield pool.submit(work, shard).result()
            except BrokenProcessPool:
                yield _lost_shard(shard, DIED)


def _start_pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, worker_context(), initializer=initialize_worker)


@contextmanager
def _one_opencv_thread() -> Iterator[None]:
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
