"""Each kernel is compiled once: for one layout of its arrays, and for one type of its numbers."""

import json
import os
import re

import numba
import pytest

from support.processes import run_python

RULES = ("auto", "known", "nearest", "mutual", "multiple")
COMMANDS = (
    "look 0.png 1.png 2.png",
    *(f"look 2.png --model {name}" for name in ("contrast", "symmetry", "boolean")),
    *(f"detect 0.png 1.png 2.png --detector {name}" for name in ("sift", "must", "symroid")),
    "detect 0.png --config sift.toml",
    "match 0.png 1.png",
    *(f"slam log.csv --association {name}" for name in RULES),
    "slam log.csv --preset kootstra2010",
    "slam log.csv --config whole.toml --save-map map.npz",
    "slam log.csv --map map.npz --mode localize --start log",
    "simulate drive --frames 12 --out seen",
    "drive seen",
    "check seen",
    "extract *.png --what sift --workers 1 --out extracted",
    "textbook 0.png",
    "simulate drive --frames 60 --preset mono --out one",
    "drive one",
)
SESSION = """
import importlib, json, sys
from pathlib import Path
import cv2
import saccade
from saccade.cli import main
from saccade.datasets import save
from saccade.simulation.world import WorldConfig, simulate_world

home = Path(saccade.__file__).parent
for i, (name, size, how) in enumerate(
    (("hallway_1", (160, 120), 1), ("hallway_2", (160, 120), 1), ("hallway_1", (90, 120), 0))
):
    cv2.imwrite(f"{i}.png", cv2.resize(cv2.imread(str(home / f"data/{name}.jpg"), how), size))
save("log.csv", simulate_world(WorldConfig(steps=150, landmarks=8)))
Path("whole.toml").write_text("motion_noise_scale = 1\\nsensor_noise_scale = 2\\n")
Path("sift.toml").write_text("contrast_threshold = 0\\nbase_sigma = 2\\n")
for words in sys.argv[1:]:
    sys.argv = ["saccade", *words.split()]
    try:
        main()
    except SystemExit as ended:
        assert not ended.code, words

found = {}
for path in home.rglob("_*kernels.py"):
    module = importlib.import_module(".".join(path.relative_to(home.parent).with_suffix("").parts))
    for kernel in vars(module).values():
        if hasattr(kernel, "signatures"):
            name = f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"
            found[name] = list(map(str, kernel.signatures))
Path("signatures.json").write_text(json.dumps(found))
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.nightly
def test_kernels_have_one_signature_after_all_commands(tmp_path):
    """Into an empty cache, since from a full one only the kernels that Python calls are loaded.

    A size that stands in the code of a caller counts as any other number.
    """
    variables = {"OMP_NUM_THREADS": "1", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    run_python("-c", SESSION, *COMMANDS, env=os.environ | variables, cwd=tmp_path, check=True)
    signatures = json.loads((tmp_path / "signatures.json").read_text())
    kinds = {
        name: {re.sub(r"Literal\[int\]\(-?\d+\)", "int64", each) for each in signatures[name]}
        for name in signatures
    }
    assert sum(map(bool, kinds.values())) > 80
    assert not {name: each for name, each in kinds.items() if len(each) > 1}
