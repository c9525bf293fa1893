"""Break files as coverage guides: `python tests/fuzz/run.py [TARGET...] --seconds 20`.

Each target in a process of its own, since libFuzzer ends the one it is in. What makes a reader
raise anything but a SaccadeError, run too long or take too much is kept as tests/fuzz/found/...
"""

import argparse
import os
import sys
import tempfile
import zipfile
from multiprocessing import get_context
from pathlib import Path

QUICK = (
    *("log-csv", "g2o", "camera-toml", "kitti-calib", "matlab", "npz", "csv"),
    *("colmap", "settings", "fixations", "tum-poses", "index-images"),
)
"""Readers of our own, where Python's coverage is of use; libraries read the other formats."""
FOUND = Path(__file__).parent / "found"
MEGABYTES, SECONDS = 2048, 120
"""That a small file may take: by the clock, of a machine that may be busy, and some compile."""


def main() -> int:
    """The exit code of the first target in whose way something came."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", default=QUICK)
    parser.add_argument("--seconds", type=int, default=20, help="for all targets together")
    parser.add_argument("--runs", type=int, default=-1, help="at most, of each target")
    parser.add_argument("--seed", type=int, default=0, help="of chance; 0: another every time")
    asked = parser.parse_args()
    share = max(1, asked.seconds // len(asked.targets))
    chosen = [f"-max_total_time={share}", f"-runs={asked.runs}", f"-seed={asked.seed}"]
    for name in asked.targets:
        print(name, flush=True)
        process = get_context("spawn").Process(target=fuzz, args=(name, chosen))
        process.start()
        process.join()
        if process.exitcode:
            return process.exitcode
    return 0


def fuzz(name: str, chosen: list[str]) -> None:
    """Never comes back: libFuzzer ends the process."""
    import atheris

    with atheris.instrument_imports(
        include=["saccade.datasets", "saccade.exchange", "saccade.io.npz"]
    ):
        import saccade.datasets
        import saccade.exchange  # noqa: F401
    from targets import TARGETS

    from saccade.errors import SaccadeError

    zipfile.ZipExtFile._update_crc = lambda self, data: None  # or nothing gets past the sums
    target, folder = TARGETS[name], Path(tempfile.mkdtemp())
    target.make(folder)
    corpus = Path(tempfile.mkdtemp())
    (corpus / "good").write_bytes((folder / target.file).read_bytes())
    target.read(folder)  # compiles

    def once(data: bytes) -> None:
        (folder / target.file).write_bytes(data)
        try:
            target.read(folder)
        except SaccadeError as error:
            if "\n" in str(error):
                raise AssertionError(f"more than one line: {error}") from error

    FOUND.mkdir(exist_ok=True)
    limits = [f"-rss_limit_mb={MEGABYTES}", f"-timeout={SECONDS}", "-max_len=20000"]
    words = [*chosen, f"-artifact_prefix={FOUND}/{name}-", str(corpus)]
    atheris.Setup([sys.argv[0], *limits, *words], once)
    atheris.Fuzz()


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    sys.exit(main())
