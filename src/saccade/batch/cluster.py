"""Dask clusters: a running scheduler, or jobs of a batch system."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from saccade.batch.engines import Work, lost_shard, run_on
from saccade.batch.shards import Shard, ShardReport
from saccade.errors import ConfigError
from saccade.extras import import_optional

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


class DaskEngine:
    """Runs shards on the workers of a Dask cluster, which must see the same files.

    Args:
        client: a `distributed.Client`.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`. Dask reruns the shards of a worker that died on another."""
        executor = self._client.get_executor(pure=False)
        for shard, future in run_on(executor, work, shards, self._count_threads):
            failure = future.exception()
            yield future.result() if failure is None else lost_shard(shard, str(failure))

    def _count_threads(self) -> int:
        """Of all workers; they may come and go."""
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
