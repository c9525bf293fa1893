"""What `saccade extract` costs beside the work: `uv run python benchmarks/extract.py`.

- overhead: one process, 640x480, in shards as large as those of a job of 10000
- two workers against one, beside what two independent loops gain at the same time on this machine
- memory: the peak of a run over 1000 and over 10000 small images
- start: from the command to the first image that is done, against a script that detects in one
- lookup: how often the right image is first (`--only lookup --pairs DIR --hallway DIR`)
- constants: what the arithmetic of docs/extract.md multiplies by millions
- thousand: the command on 1000 photographs, to check that arithmetic
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np

from saccade import Sift, read_image
from saccade.batch import Job, extract, open_source, shards
from saccade.batch.dataset import read_points
from saccade.batch.engines import InProcess, Processes, worker_context
from saccade.batch.index import Found, Index, build_index
from saccade.keypoints.sift_config import SiftConfig

JOB = Job("sift", SiftConfig())
BARE = "import sys, saccade; saccade.Sift(threads=1)(saccade.read_image(sys.argv[1]))"
LAP, NEAR = 40, 2
PARTS = ("overhead", "workers", "memory", "start", "constants", "thousand", "lookup")
PEAK = """
import resource, sys
from saccade import Sift, read_image
from saccade.batch import Job, extract, open_source
from saccade.batch.engines import InProcess
from saccade.keypoints.sift_config import SiftConfig
extract(open_source(sys.argv[1]), Job("sift", SiftConfig()), sys.argv[2], InProcess())
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def photographs(folder: Path, pairs: Path | None, count: int) -> None:
    """VGA photographs as JPEG; each a little different from all others."""
    names = ("astronaut", "chelsea", "coffee", "hallway_1", "hallway_2", "rocket")
    found = [Path(str(files("saccade") / "data" / f"{name}.jpg")) for name in names]
    if pairs is not None:
        found = sorted(pairs.rglob("*.png"))
    for number in range(count):
        image = cv2.imread(str(found[number % len(found)]))
        image = cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{number:05d}.jpg"), np.roll(image, number, axis=1))


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def timed(owner: object, name: str, spent: list[float]) -> None:
    """Let a function of a module note how much processor time it takes."""
    function = getattr(owner, name)

    def call(*arguments: object, **options: object) -> object:
        start = time.process_time()
        result = function(*arguments, **options)
        spent[0] += time.process_time() - start
        return result

    setattr(owner, name, call)


def overhead(folder: Path, runs: int) -> None:
    """Processor time of a run, over what reading, decoding and detecting take in the same run.

    In turns with a loop they would differ by what else the machine does meanwhile.
    """
    source, count = open_source(str(folder)), len(list(folder.iterdir()))
    spent, besides = [0.0], [0.0]
    timed(shards, "_extract_image", spent)
    timed(shards, "content_hash", besides)
    shares = []
    for run in range(runs + 1):
        with tempfile.TemporaryDirectory() as out:
            spent[0] = besides[0] = 0.0
            start = time.process_time()
            totals = extract(source, JOB, out, InProcess(), shard_size=256).totals
            whole, bare = time.process_time() - start, spent[0] - besides[0]
            size = sum(path.stat().st_size for path in Path(out, "sift").iterdir())
        if run > 0:  # in the first the libraries are loaded
            shares.append(whole / bare)
            print(
                f"{count} images 640x480: read and detect {1e3 * bare / count:.1f} ms/image, "
                f"all {1e3 * whole / count:.1f} ms/image, ratio {shares[-1]:.3f}",
                flush=True,
            )
    print(f"overhead: {100 * (np.median(shares) - 1):.1f} % (median of {runs})")
    print(
        f"size: {size / totals.rows:.1f} bytes a point, {totals.rows / count:.0f} points an image"
    )


def workers(folder: Path, runs: int) -> None:
    """Two workers against one, in turns with loops that share nothing: what the machine allows."""
    source = open_source(str(folder))
    paths = sorted(str(path) for path in folder.glob("*.jpg"))
    rows = []
    with ProcessPoolExecutor(2, worker_context()) as pool:
        list(pool.map(loop, [paths[:8]] * 4))  # all is loaded
        for _ in range(runs):
            times = []
            for count in (1, 2):
                loops = [paths[::2], paths[1::2]] if count == 2 else [paths]
                times.append(seconds(lambda each=loops: list(pool.map(loop, each))))
                with tempfile.TemporaryDirectory() as out:
                    engine = Processes(count)
                    times.append(seconds(lambda e=engine, o=out: extract(source, JOB, o, e)))
            rows.append(times)
            print(
                "  loop, worker, two loops, two workers: {:.2f} {:.2f} {:.2f} {:.2f} s".format(
                    *times
                )
            )
    loop1, worker1, loop2, worker2 = np.transpose(rows)
    ceiling, gain = loop1 / loop2, worker1 / worker2
    print(f"two workers: {np.median(gain):.2f} times one (median of {runs}, best {gain.max():.2f})")
    print(f"two loops that share nothing: {np.median(ceiling):.2f} (best {ceiling.max():.2f})")
    print(f"two workers over two loops: {np.median(loop2 / worker2):.2f}")


def loop(paths: list[str]) -> None:
    """Detect in every image, and throw away what is found."""
    cv2.setNumThreads(1)
    sift = Sift(threads=1)
    for path in paths:
        sift(read_image(path))


def memory() -> None:
    """Peak of a run, in a fresh process."""
    peaks = {}
    image = cv2.imread(str(files("saccade") / "data" / "hallway_1.jpg"))[100:164, 100:196]
    whole, packed = cv2.imencode(".png", image)
    assert whole
    for count in (1000, 10_000):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "in").mkdir()
            for number in range(count):
                (Path(folder) / "in" / f"{number:06d}.png").write_bytes(packed.tobytes())
            words = [sys.executable, "-c", PEAK, f"{folder}/in", f"{folder}/out"]
            peaks[count] = int(subprocess.check_output(words)) / 1024
            print(f"{count} small images: peak {peaks[count]:.0f} MB", flush=True)
    print(f"memory: {peaks[10_000] / peaks[1000]:.3f} times as much for ten times as many")


def start(folder: Path, runs: int) -> None:
    """To the first image that is done, by the default of two cores and by one process.

    With bytecode on disk, as pip leaves it.
    """
    some = folder / "some"
    some.mkdir()
    for path in sorted(folder.glob("*.jpg"))[:8]:
        (some / path.name).write_bytes(path.read_bytes())
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    program = str(Path(sys.executable).with_name("saccade"))
    command = [program, "extract", str(some), "--shard", "1", "--out"]
    script = [sys.executable, "-c", BARE, str(some / "00000.jpg")]
    rows = []
    for run in range(runs + 1):
        with tempfile.TemporaryDirectory() as out:
            times = [
                seconds(lambda: subprocess.run(script, env=environment, check=True)),
                to_the_first([*command, f"{out}/2"], Path(out, "2"), environment),
                to_the_first([*command, f"{out}/1", "--workers", "1"], Path(out, "1"), environment),
            ]
        if run > 0:  # in the first, bytecode is written
            rows.append(times)
    bare, two, one = np.median(rows, axis=0)
    print(f"start: a script that detects in one image {bare:.2f} s (median of {runs})")
    for name, took in (("by default", two), ("--workers 1", one)):
        print(f"start: the first record {name} {took:.2f} s: {took - bare:.2f} s more")


def to_the_first(command: list[str], out: Path, environment: dict[str, str]) -> float:
    """Seconds until the record of an image is there."""
    start = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL):
        while not list(out.glob("images/part-*")):
            time.sleep(0.005)
        return time.perf_counter() - start


def lookup(pairs: Path, hallway: Path) -> None:
    """Every image is asked for in a data set of all, itself left out.

    Right is another of its sequence; of the hallway, which is walked twice in laps of `LAP`
    photographs, the first that is of the other lap must be at most `NEAR` from the same place.
    """
    for name, source, right in (
        ("sequences", f"{pairs}/*/*.png", of_its_sequence),
        ("hallway", str(hallway), of_its_place),
    ):
        with tempfile.TemporaryDirectory() as out:
            extract(open_source(source), JOB, out, InProcess())
            build_index(out)
            held = Index(out)
            asked = [each.image for each in read_points(out)]
            points = {each.image: each.points for each in read_points(out)}
            count = sum(right(image, held.find(points[image], exclude=image)) for image in asked)
            empty = sum(not len(points[image]) for image in asked)
        print(f"lookup: {name} {count} of {len(asked)}, {empty} without points", flush=True)


def of_its_sequence(image: str, found: list[Found]) -> bool:
    return bool(found) and Path(found[0].image).parent == Path(image).parent


def of_its_place(image: str, found: list[Found]) -> bool:
    apart = (abs(int(Path(each.image).stem) - int(Path(image).stem)) for each in found)
    first = next((each for each in apart if each > LAP / 2), None)
    return first is not None and min(first % LAP, -first % LAP) <= NEAR


def constants(folder: Path) -> None:
    """Bytes of a record and of a name, the time of a second run and of a task of Dask's."""
    source, count = open_source(str(folder)), len(list(folder.iterdir()))
    with tempfile.TemporaryDirectory() as out:
        made = extract(source, JOB, out, InProcess(), shard_size=256).totals
        again = seconds(lambda: extract(source, JOB, out, InProcess(), shard_size=256))
        record = sum(path.stat().st_size for path in Path(out, "images").iterdir())
        most = build_index(out, 500)["points"]
        index = sum(path.stat().st_size for path in Path(out, "index").iterdir())
    print(f"record: {record / count:.0f} bytes an image")
    print(f"nothing to do: {1e3 * again / count:.2f} ms an image")
    print(f"index: {index / most:.0f} bytes a point, {most} of {made.rows} points")
    from distributed import Client, LocalCluster

    with (
        LocalCluster(1, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        tasks = 2000
        client.gather(client.map(abs, range(100), pure=False))
        took = seconds(lambda: client.gather(client.map(abs, range(tasks), pure=False)))
    print(f"Dask: {1e3 * took / tasks:.2f} ms a task that does nothing")


def thousand() -> None:
    """The command on 1000 photographs: what the arithmetic says of them, and what they take."""
    with tempfile.TemporaryDirectory() as name:
        source, out = Path(name, "photographs"), Path(name, "out")
        source.mkdir()
        photographs(source, None, 1000)
        program = str(Path(sys.executable).with_name("saccade"))
        words = [program, "extract", str(source), "--out", str(out)]
        took = seconds(lambda: subprocess.run(words, check=True, stdout=subprocess.DEVNULL))
        sizes = [path.stat().st_size for path in out.rglob("part-*")]
    print(f"1000 photographs: {took:.0f} s on {os.cpu_count()} cores, start and all")
    print(f"1000 photographs: {sum(sizes) / 1e6:.1f} MB in {len(sizes)} files")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=Path, help="folder of sequences with 1.png")
    parser.add_argument("--hallway", type=Path, help="folder of photographs of two laps")
    parser.add_argument("--images", type=int, default=96)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", choices=PARTS)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        photographs(folder, options.pairs, options.images)
        parts = {
            "overhead": lambda: overhead(folder, options.runs),
            "workers": lambda: workers(folder, options.runs),
            "memory": memory,
            "start": lambda: start(folder, options.runs),
            "constants": lambda: constants(folder),
            "thousand": thousand,
        }
        if options.only == "lookup" and not (options.pairs and options.hallway):
            parser.error("lookup: expected --pairs and --hallway")
        if options.pairs and options.hallway:
            parts["lookup"] = lambda: lookup(options.pairs, options.hallway)
        for part, measure in parts.items():
            if options.only in (None, part):
                measure()


if __name__ == "__main__":
    main()
