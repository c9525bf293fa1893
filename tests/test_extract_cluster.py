"""The same job on Dask: a scheduler and two workers, each a process of its own."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from extracting import check_complete, photographs

distributed = pytest.importorskip("distributed")

IMAGES = 30


def start(program, *words):
    """A process of Dask's."""
    command = [sys.executable, "-m", f"distributed.cli.dask_{program}", "--no-dashboard", *words]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


@pytest.fixture
def cluster(tmp_path):
    """Address of a scheduler, and the processes of its two workers."""
    file = ("--scheduler-file", str(tmp_path / "scheduler.json"))
    scheduler = start("scheduler", "--port", "0", "--host", "127.0.0.1", *file)
    one = ("--nthreads", "1", "--no-nanny", *file)
    workers = [start("worker", *one) for _ in range(2)]
    try:
        while not (tmp_path / "scheduler.json").exists():
            assert scheduler.poll() is None
            time.sleep(0.01)
        address = json.loads((tmp_path / "scheduler.json").read_text())["address"]
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2)
        yield address, workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def test_a_worker_that_is_killed_loses_nothing(cluster, run, tmp_path):
    address, workers = cluster
    source, out = tmp_path / "photos", tmp_path / "out"
    photographs(source, IMAGES)

    def kill_one():
        while len(list((out / "images").glob("*"))) < 5:
            time.sleep(0.01)
        os.kill(workers[0].pid, signal.SIGKILL)

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    code, printed, err = run(
        "extract", source, "--out", out, "--scheduler", address, "--shard", 1, "--json"
    )
    killer.join(1)
    assert code == 0, err
    assert f'"images": {IMAGES}' in printed
    assert workers[0].wait(5) == -signal.SIGKILL
    check_complete(source, out)


def test_a_scheduler_that_is_not_there_is_named(run, tmp_path, monkeypatch):
    photographs(tmp_path / "photos", 1)
    monkeypatch.setattr("saccade.batch.cluster.PATIENCE", 0.3)
    code, _, err = run("extract", tmp_path / "photos", "--scheduler", "tcp://127.0.0.1:9")
    assert code == 2
    assert "scheduler: expected one at tcp://127.0.0.1:9, found none" in err
