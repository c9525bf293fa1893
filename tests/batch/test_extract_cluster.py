"""The same job on Dask: a scheduler and two workers, each a process of its own."""

import os
import signal
import threading
import time

import pytest

from support.extraction import check_complete, photographs
from support.limits import TIMEOUT

distributed = pytest.importorskip("distributed")

IMAGES = 30


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Address of a scheduler, and the number of the process of one of its two workers."""
    monkeypatch.setattr("saccade.workers.SCHEDULER_TIMEOUT", TIMEOUT)
    options = {"dashboard_address": ":0", "local_directory": tmp_path / "dask"}
    with (
        distributed.LocalCluster(2, threads_per_worker=1, **options) as cluster,
        distributed.Client(cluster, timeout=TIMEOUT, set_as_default=False) as client,
    ):
        client.wait_for_workers(2)
        yield cluster.scheduler_address, min(client.run(os.getpid).values())


@pytest.mark.nightly
def test_a_worker_that_is_killed_loses_nothing(cluster, run, tmp_path):
    address, worker = cluster
    source, out = tmp_path / "photos", tmp_path / "out"
    photographs(source, IMAGES)

    killed = threading.Event()

    def kill_one():
        while len(list((out / "sift").glob("[!.]*.parquet"))) < 2:
            time.sleep(0.01)
        os.kill(worker, signal.SIGKILL)
        killed.set()

    threading.Thread(target=kill_one, daemon=True).start()
    code, printed, err = run("extract", source, "--out", out, "--scheduler", address, "--json")
    assert code == 0, err
    assert f'"images": {IMAGES}' in printed
    assert killed.wait(TIMEOUT)
    check_complete(source, out)


def test_a_scheduler_that_is_not_there_is_named(run, tmp_path, monkeypatch):
    photographs(tmp_path / "photos", 1)
    monkeypatch.setattr("saccade.workers.SCHEDULER_TIMEOUT", 0.3)
    code, _, err = run("extract", tmp_path / "photos", "--scheduler", "tcp://127.0.0.1:9")
    assert code == 2
    assert "scheduler: expected one at tcp://127.0.0.1:9, found none" in err
