"""Every command of `saccade`, with words that have it do some of its work soon."""

import json
from contextlib import redirect_stdout
from io import StringIO

from fuzz.targets import TARGETS
from saccade import slam
from saccade.cli import COMMANDS as PANELS
from saccade.cli import EVALUATIONS, app, run_command
from saccade.simulation import WorldConfig, simulate_world

COMMANDS = {
    "look": "{in}/photos/a.png --length 2 -f csv -f svg --maps npy --maps tiff",
    "detect": "{in}/photos/a.png --max 5 -f npz -f csv -f hdf5 -o out",
    "extract": "{in}/photos --workers 1 -o out",
    "convert --to": "hdf5 {in}/points x.h5",
    "match": "{in}/photos/a.png {in}/photos/b.png -o out",
    "match --workers": "1 {in}/photos -o out",
    "slam": "{in}/log.csv -o out",
    "merge": "{in}/a.map.npz {in}/a.map.npz -o both.npz",
    "check": "{in}/drive",
    "convert": "{in}/log.csv log.g2o",
    "drive": "{in}/drive --frames 3 -o out",
    "serve": "--no-browser --port {port}",
    "demo": "--out {in}/log.csv",
    "evaluate fixations": "--images {in}/seen --fixations {in}/seen/fixations.csv",
    "fit": "--images {in}/seen --fixations {in}/seen/fixations.csv --folds 2",
    "evaluate scanpaths": "--images {in}/seen --fixations {in}/seen/people.csv --samples 2",
    "evaluate features": "--pairs {in}/pairs --points 20",
    "tags": "--ids 0 tags.pdf",
    "simulate": "world --config {in}/world.toml -o out",
    "simulate --frames": "2 drive --config {in}/drive.toml -o out",
    "textbook": "{in}/log.csv -o out",
    "config": "sift",
}
"""Every command, or one with an option that has it do other work; {in} is what `make_inputs` fills,
{port} is taken."""
EXITS = {"check": 1, "demo": 1, "serve": 2}
"""Exit codes that are not 0 where nothing is amiss with the environment."""


def all_commands():
    """The application of each command, with its name."""
    for panels, group in ((PANELS, []), (EVALUATIONS, ["evaluate"])):
        for name in (name for commands in panels.values() for name in commands):
            _, apps, _ = app.parse_commands([*group, name])
            yield " ".join([*group, name]), apps[-1]


def words_of(name, folder, port):
    """The words of a command whose inputs are in a folder."""
    rest = COMMANDS[name].format(**{"in": folder, "port": port})
    return [*name.split(), *rest.split()]


def json_of(*words):
    """What a command prints with --json; errors are raised."""
    with redirect_stdout(StringIO()) as printed:
        assert run_command([*map(str, words), "--json"]) == 0
    return json.loads(printed.getvalue())


def make_inputs(folder):
    """Write what the words name."""
    for name, target in (
        ("seen", "fixations"),
        ("pairs", "homography"),
        ("drive", "folder-times"),
        ("made", "points-table"),
        (".", "log-csv"),
        (".", "world"),
        (".", "drive-settings"),
    ):
        (folder / name).mkdir(exist_ok=True)
        TARGETS[target].make(folder / name)
    (folder / "made" / "out").rename(folder / "points")
    (folder / "photos").mkdir()
    picture = (folder / "seen" / "a.png").read_bytes()
    for place in ("photos/a", "photos/b", "seen/b", "seen/c", "seen/d"):
        (folder / f"{place}.png").write_bytes(picture)
    with (folder / "seen" / "fixations.csv").open("a") as fixations:
        fixations.writelines(f"{name}.png,1,0,9,7\n{name}.png,1,1,2,8\n" for name in "bcd")
    with (folder / "seen" / "people.csv").open("w") as people:
        people.write("image,viewer,index,x,y\n")
        for image, viewer in ("a1", "a2", "b1", "b2"):
            people.writelines(f"{image}.png,{viewer},{k},{3 * k},{viewer}\n" for k in range(4))
    log = simulate_world(WorldConfig(steps=300))
    robot = slam.slam_for(log)
    slam.run(log, initial=robot)
    robot.save(folder / "a.map.npz")
