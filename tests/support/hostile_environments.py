"""Every command of `saccade` in hostile environments: full disks, closed streams, no libraries.

As a program it runs them: it imports all that commands need once, by running each, and forks for
every run.
"""

import io
import json
import os
import re
import resource
import shutil
import signal
import socket
import sys
import traceback
from contextlib import redirect_stdout, suppress
from pathlib import Path

import cv2
import typer

from fuzz.targets import TARGETS, a_picture
from saccade import slam
from saccade.cli import TRACEBACK, app
from saccade.simulation import WorldConfig, simulate_world

COMMANDS = {
    "look": "{in}/photos/a.png --fixations 2 -f csv -f mat -f svg --maps npy --maps tiff",
    "detect": "{in}/photos/a.png --max 5 -f npz -f csv -f hdf5 -f parquet -o out",
    "extract": "{in}/photos --workers 1 -o out",
    "convert --to": "hdf5 {in}/points x.h5",
    "find --in": "{in}/points",
    "find": "{in}/photos/a.png --in {in}/points",
    "match": "{in}/photos/a.png {in}/photos/b.png -o out",
    "match --workers": "1 {in}/photos -o out",
    "slam": "{in}/log.csv --no-film -o out",
    "check": "{in}/drive",
    "convert": "{in}/log.csv log.g2o",
    "drive": "{in}/drive --no-film --frames 3 -o out --save-tracks tracks",
    "serve": "--no-browser --port {port}",
    "demo": "--out {in}/log.csv",
    "evaluate fixations": "--images {in}/seen --fixations {in}/seen/fixations.csv",
    "fit": "--images {in}/seen --fixations {in}/seen/fixations.csv --folds 2 --no-people",
    "evaluate scanpaths": "--images {in}/seen --fixations {in}/seen/people.csv --samples 2 -o out",
    "evaluate features": "--pairs {in}/pairs --points 20",
    "evaluate features --drive": "{in}/kitti --points 20",
    "evaluate gaze": "--world pond --policy sweep --seeds 1 -o out",
    "evaluate trajectory": "{in}/a.tum --truth {in}/a.tum --csv out/a.csv --report out/a.html",
    "slam --merge": "{in}/a.map.npz,{in}/a.map.npz --save-map merged.npz",
    "simulate": "world --config {in}/world.toml -o out",
    "simulate --frames": "2 drive --config {in}/drive.toml -o out",
    "textbook": "{in}/log.csv -o out",
    "config": "sift",
}
"""Every command, or one with an option that has it do other work, with words that have it do some
of its work soon; {port} is taken."""
EXITS = {"find": 1, "check": 1, "demo": 1, "serve": 2}
"""Exit codes that are not 0 where nothing is amiss with the environment."""
TRACEBACK_EXIT = 99
"""Exit code that stands for a traceback."""


def all_commands(group=None, *names):
    """Names of all commands that there are."""
    for name, command in (group or typer.main.get_command(app)).commands.items():
        if hasattr(command, "commands"):
            yield from all_commands(command, *names, name)
        else:
            yield " ".join((*names, name))


def make_inputs(folder):
    """What the words name."""
    TARGETS["log-csv"].make(folder)
    for name, target in (
        ("seen", "fixations"),
        ("pairs", "homography"),
        ("drive", "folder-times"),
        ("kitti", "kitti-poses"),
    ):
        (folder / name).mkdir()
        TARGETS[target].make(folder / name)
    for name in "bcd":
        (folder / "seen" / f"{name}.png").write_bytes((folder / "seen" / "a.png").read_bytes())
        with (folder / "seen" / "fixations.csv").open("a") as fixations:
            fixations.write(f"{name}.png,1,0,9,7\n{name}.png,1,1,2,8\n")
    rows = [
        f"{image}.png,{viewer},{k},{3 * k},{viewer}"
        for image in "ab"
        for viewer in "12"
        for k in range(4)
    ]
    (folder / "seen" / "people.csv").write_text("\n".join(["image,viewer,index,x,y", *rows]) + "\n")
    (folder / "photos").mkdir()
    for name in "ab":
        cv2.imwrite(str(folder / "photos" / f"{name}.png"), a_picture())
    (folder / "made").mkdir()
    TARGETS["index-images"].make(folder / "made")
    (folder / "made" / "out").rename(folder / "points")
    (folder / "a.tum").write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 2 1 0 0 0 0 1\n")
    robot = slam.slam_for(simulate_world(WorldConfig(steps=300)))
    slam.run(simulate_world(WorldConfig(steps=300)), initial=robot)
    robot.save(folder / "a.map.npz")
    (folder / "world.toml").write_text("steps = 20\nlandmarks = 5\n")
    (folder / "drive.toml").write_text("frames = 2\nimage_size = [64, 48]\n")


def with_ascii():
    """Streams as Python opens them where PYTHONIOENCODING is ascii."""
    sys.stdout.reconfigure(encoding="ascii", errors="strict")
    sys.stderr.reconfigure(encoding="ascii")


def with_closed_stdout():
    """As with >&- in a shell."""
    sys.stdout = None
    os.close(1)


def with_closed_streams():
    """As with <&- >&- 2>&- in a shell."""
    with_closed_stdout()
    sys.stdin = sys.stderr = None
    os.close(0)
    os.close(2)


def with_full_stdout():
    """Nothing can be printed."""
    os.dup2(os.open("/dev/full", os.O_WRONLY), 1)


def with_full_disk():
    """No file can grow over 500 bytes."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))


def without_folder():
    """The working folder is gone."""
    Path.cwd().rmdir()


def with_files_in_the_way():
    """Where a folder or a file is to be made there is a file, or a folder."""
    for name in ("out", "saccade-look", "saccade-world"):
        Path(name).touch()
    for name in ("out.h5", "log.g2o"):
        Path(name).mkdir()


def without(*libraries):
    """As if libraries were not installed, and nothing of ours had been loaded with them."""

    class Without:
        """A finder that finds none of them."""

        def __init__(self, finder):
            self.finder = finder

        def __getattr__(self, name):
            return getattr(self.finder, name)

        def find_spec(self, name, path=None, target=None):
            if name.partition(".")[0] in libraries:
                return None
            return self.finder.find_spec(name, path, target)

    def prepare():
        for name in list(sys.modules):
            if name.partition(".")[0] in (*libraries, "saccade"):
                del sys.modules[name]
        sys.meta_path[:] = map(Without, sys.meta_path)

    return prepare


OPTIONAL = (
    *("pyarrow", "h5py", "gtsam", "rosbags", "faiss", "zarr", "fsspec", "starlette", "uvicorn"),
    *("rerun", "distributed", "dask", "pycolmap"),
)
FILE = "{in}/log.csv"
"""In the place of a folder."""
ODD = "\udcff"
"""A byte that is not UTF-8, in a name as Python has it."""
ENVIRONMENTS = {
    "bytes": (None, {}),
    "ascii": (with_ascii, {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0"}),
    "nowhere": (
        None,
        {
            **dict.fromkeys(("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), FILE),
            **dict.fromkeys(("NUMBA_CACHE_DIR", "MPLCONFIGDIR"), FILE),
            **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), "{in}/nowhere"),
        },
    ),
    "narrow": (None, {"COLUMNS": "0", "LINES": "-1", "TERMINAL_WIDTH": "x", "TERM": "dumb"}),
    "color": (None, {"COLUMNS": "nonsense", "TERM": "nonsense", "FORCE_COLOR": "1"}),
    "pixels": (None, {"OPENCV_IO_MAX_IMAGE_PIXELS": "nonsense"}),
    "closed": (with_closed_stdout, {}),
    "all-closed": (with_closed_streams, {}),
    "full": (with_full_stdout, {}),
    "full-disk": (with_full_disk, {}),
    "gone-folder": (without_folder, {}),
    "in-the-way": (with_files_in_the_way, {}),
    "bare": (without(*OPTIONAL), {}),
    **{f"no-{library}": (without(library), {}) for library in OPTIONAL},
}
"""By name: what is done to the process before the command, and variables."""


def run_all(folder, cases):
    """Run (environment, command) pairs; gives exit code, stdout and stderr of each."""
    (folder / "in").mkdir()
    make_inputs(folder / "in")
    cv2.setNumThreads(1)  # a fork has no other
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        held = {"in": str(folder / "in"), "port": str(taken.getsockname()[1])}
        words = {
            name: [*name.split(), *(each.format(**held) for each in rest.split())]
            for name, rest in COMMANDS.items()
        }
        os.chdir(folder)
        Path(f"in{ODD}").symlink_to("in")
        for name in sorted({command for _, command in cases}):  # loads everything, here first
            with redirect_stdout(io.StringIO()):
                code = ended(words[name])
            shutil.rmtree("out", ignore_errors=True)
            assert code == EXITS.get(name, 0), name
        return [forked(folder, held, environment, words[name]) for environment, name in cases]


def odd(words):
    """The words with other names of what is read, and of what is made."""
    for word in words:
        yield re.sub(r"(/in|^out|^log)\b", rf"\1{ODD}", word)


def ended(words):
    """The exit code of a command, as the interpreter would end with it."""
    from saccade.cli import main  # anew, where it was forgotten

    sys.argv = ["saccade", *words]
    try:
        main()
    except SystemExit as error:
        return error.code or 0
    except BaseException:
        traceback.print_exc()
        return TRACEBACK_EXIT


def forked(folder, held, environment, words):
    """Run a command in a child, in an empty folder: its exit code, stdout and stderr."""
    place, streams = folder / "run", [folder / "stdout", folder / "stderr"]
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    child = os.fork()
    if child == 0:
        code = TRACEBACK_EXIT
        try:
            for number, path in enumerate(streams, 1):
                os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            sys.stdout, sys.stderr = (
                open(number, "w", encoding="utf-8", errors=errors, closefd=False)  # noqa: SIM115
                for number, errors in ((1, "strict"), (2, "backslashreplace"))
            )
            os.chdir(place)
            prepare, variables = ENVIRONMENTS[environment]
            os.environ.update({name: each.format(**held) for name, each in variables.items()})
            os.environ.pop(TRACEBACK, None)
            if prepare is not None:
                prepare()
            code = ended(list(odd(words)) if environment == "bytes" else words)
            sys.stdout.flush()
            with suppress(OSError):  # as the interpreter does
                sys.stderr.flush()
        except BaseException:
            code = TRACEBACK_EXIT
            os.write(2, traceback.format_exc().encode())
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return code, *(path.read_bytes().decode("utf-8", "replace") for path in streams)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / "results.json").write_text(json.dumps(run_all(folder, json.load(sys.stdin))))
