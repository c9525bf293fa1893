"""The same job on Dask: a scheduler and two workers, each a process of its own."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from support.extraction import check_complete, photographs
from support.limits import TIMEOUT
from support.paths import ROOT

distributed = pytest.importorskip("distributed")

IMAGES = 30


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Address of a scheduler, and the number of the process of one of its two workers."""
    monkeypatch.setattr("saccade.batch.engines.TIMEOUT", TIMEOUT)
    command = [sys.executable, "-m", "support.dask_cluster", tmp_path]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, text=True, cwd=ROOT / "tests", **pipes) as process:
        address, first, _ = process.stdout.readline().split()
        with distributed.Client(address, timeout=TIMEOUT, set_as_default=False) as client:
            client.wait_for_workers(2)
        yield address, int(first)
        process.stdin.close()


def test_a_worker_that_is_killed_loses_nothing(cluster, run, tmp_path):
    address, worker = cluster
    source, out = tmp_path / "photos", tmp_path / "out"
    photographs(source, IMAGES)

    killed = threading.Event()

    def kill_one():
        while len(list((out / "images").glob("*"))) < 5:
            time.sleep(0.01)
        os.kill(worker, signal.SIGKILL)
        killed.set()

    threading.Thread(target=kill_one, daemon=True).start()
    code, printed, err = run(
        "extract", source, "--out", out, "--scheduler", address, "--shard", 1, "--json"
    )
    assert code == 0, err
    assert f'"images": {IMAGES}' in printed
    assert killed.wait(TIMEOUT)
    check_complete(source, out)


def test_a_scheduler_that_is_not_there_is_named(run, tmp_path, monkeypatch):
    photographs(tmp_path / "photos", 1)
    monkeypatch.setattr("saccade.batch.engines.TIMEOUT", 0.3)
    code, _, err = run("extract", tmp_path / "photos", "--scheduler", "tcp://127.0.0.1:9")
    assert code == 2
    assert "scheduler: expected one at tcp://127.0.0.1:9, found none" in err


BATCH_SYSTEM = {
    "sbatch": """#!/bin/sh
cp "$1" "$(dirname "$0")/job.sh"
setsid sh "$(dirname "$0")/job.sh" >"$(dirname "$0")/log" 2>&1 </dev/null &
echo "Submitted batch job $!"
""",
    "scancel": '#!/bin/sh\nkill -- "-$1"\ntouch "$(dirname "$0")/cancelled"\n',
}
"""Commands of Slurm for a job that starts at once, on this machine."""


def test_jobs_of_a_batch_system_do_the_work(run, tmp_path, monkeypatch):
    """All but the queue is real: dask-jobqueue's script is submitted, run and cancelled."""
    pytest.importorskip("dask_jobqueue")
    system, source = tmp_path / "system", tmp_path / "photos"
    system.mkdir()
    for name, script in BATCH_SYSTEM.items():
        (system / name).write_text(script)
        (system / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(system), prepend=os.pathsep)
    photographs(source, 4)
    code, printed, err = run("extract", source, "--out", "out", "--cluster", "slurm", "--json")
    assert code == 0, err
    assert '"images": 4' in printed
    script = (system / "job.sh").read_text()
    assert "#SBATCH --cpus-per-task=1" in script
    assert "--nthreads 1" in script
    assert (system / "cancelled").exists()
    check_complete(source, tmp_path / "out")
