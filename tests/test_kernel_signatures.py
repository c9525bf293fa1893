"""Each kernel is compiled once: for one layout of its arrays, and for one type of its numbers."""

import json
import os

import numba
import pytest

from support.processes import run_python

SESSION = """
import importlib, json, os, sys
from pathlib import Path
os.cpu_count = lambda: 1  # no other process compiles ahead
import cv2
import saccade
from saccade.cli import main
from saccade.datasets import save
from saccade.simulation.world import WorldConfig, simulate_world

out = Path(sys.argv[1])
home = Path(saccade.__file__).parent

def run(*words):
    sys.argv = ["saccade", *map(str, words)]
    try:
        main()
    except SystemExit as ended:
        assert not ended.code, words

photos = []
for i, (name, size, how) in enumerate(
    (("hallway_1", (160, 120), 1), ("hallway_2", (160, 120), 1), ("hallway_1", (90, 120), 0))
):
    photos.append(out / f"{i}.png")
    cv2.imwrite(str(photos[-1]), cv2.resize(cv2.imread(str(home / f"data/{name}.jpg"), how), size))
log, world = out / "log.csv", simulate_world(WorldConfig(steps=150, landmarks=8))
save(log, world)
(out / "whole.toml").write_text("motion_noise_scale = 1\\nsensor_noise_scale = 2\\n")
(out / "sift.toml").write_text("contrast_threshold = 0\\nbase_sigma = 2\\n")

run("look", *photos, "--out", out / "look")
for name in ("contrast", "symmetry", "boolean"):
    run("look", photos[2], "--model", name, "--out", out / name)
for name in ("sift", "must", "symroid"):
    run("detect", *photos, "--detector", name, "--out", out / name)
run("detect", photos[0], "--config", out / "sift.toml", "--out", out / "whole")
run("match", *photos[:2], "--out", out / "match")
for name in ("auto", "known", "nearest", "mutual", "multiple"):
    run("slam", log, "--association", name, "--no-film", "--out", out / name)
run("slam", log, "--config", out / "whole.toml", "--save-map", out / "map.npz", "--no-film",
    "--out", out / "w")
run("slam", log, "--map", out / "map.npz", "--mode", "localize", "--start", "log", "--no-film",
    "--out", out / "l")
run("simulate", "drive", "--frames", "12", "--out", out / "seen")
run("drive", out / "seen", "--no-film", "--out", out / "drive")
run("check", out / "seen")
run("extract", out / "*.png", "--what", "sift", "--workers", "1", "--out", out / "extracted")
run("textbook", photos[0], "--out", out / "textbook")
run("slam", log, "--preset", "kootstra2010", "--no-film", "--out", out / "standard")
run("simulate", "drive", "--frames", "60", "--preset", "mono", "--out", out / "one")
run("drive", out / "one", "--no-film", "--out", out / "mono")

found = {}
for path in home.rglob("_*kernels.py"):
    module = importlib.import_module(".".join(path.relative_to(home.parent).with_suffix("").parts))
    for name, kernel in vars(module).items():
        if hasattr(kernel, "signatures"):
            found[f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"] = list(
                map(str, kernel.signatures)
            )
(out / "signatures.json").write_text(json.dumps(found))
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.nightly
def test_kernels_have_one_signature_after_all_commands(tmp_path):
    """Into an empty cache, since from a full one only the kernels that Python calls are loaded."""
    variables = {"OMP_NUM_THREADS": "1", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    run_python("-c", SESSION, tmp_path, env=os.environ | variables, cwd=tmp_path, check=True)
    signatures = json.loads((tmp_path / "signatures.json").read_text())
    called = {name: each for name, each in signatures.items() if each}
    assert len(called) > 100
    assert not {name: each for name, each in called.items() if len(each) > 1}
