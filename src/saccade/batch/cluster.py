"""The door to Dask: a scheduler that is there, or one that a batch system is asked for."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from saccade.batch.engines import Cluster
from saccade.errors import ConfigError
from saccade.extras import import_optional

SYSTEMS = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "htcondor": "HTCondorCluster",
    "oar": "OARCluster",
}
"""Batch systems, and what dask-jobqueue calls them."""
A_JOB = {"cores": 1, "memory": "2GB"}
"""What a job asks for where dask-jobqueue's file of settings does not say."""
TIMEOUT = 20.0
"""Seconds in which a scheduler must answer."""


@contextmanager
def scheduler_at(address: str) -> Iterator[Cluster]:
    """The workers of a scheduler that is running, such as tcp://host:8786.

    Raises:
        ConfigError: Dask is not installed, or nothing answers there.
    """
    distributed = import_optional("distributed", "cluster")
    try:
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"scheduler: expected one at {address}, found none: {error}") from error
    with client:
        yield Cluster(client)


@contextmanager
def batch_system(name: str, jobs: int) -> Iterator[Cluster]:
    """Workers in jobs of a batch system, set up as dask-jobqueue's own file of settings says.

    Args:
        name: one of `SYSTEMS`.
        jobs: how many to submit; they begin to work as they start.

    Raises:
        ConfigError: there is no such system, dask-jobqueue is not installed, or what it needs
            is not set.
    """
    if name not in SYSTEMS:
        raise ConfigError(f"cluster: expected one of {', '.join(SYSTEMS)}, found {name!r}")
    jobqueue = import_optional("dask_jobqueue", "cluster")
    dask = import_optional("dask", "cluster")
    distributed = import_optional("distributed", "cluster")
    with ExitStack() as stack:
        set_there = dask.config.get(f"jobqueue.{name}", {})
        asked = {each: value for each, value in A_JOB.items() if set_there.get(each) is None}
        try:
            cluster = stack.enter_context(getattr(jobqueue, SYSTEMS[name])(**asked))
            cluster.scale(jobs=jobs)
        except (OSError, RuntimeError, ValueError) as error:
            raise ConfigError(f"cluster: {name} cannot be used: {error}") from error
        client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
        client.wait_for_workers(1)
        yield Cluster(client)
