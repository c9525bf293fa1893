"""Map files: the whole state of a `Slam` in one .npz, for another day or another robot.

Plain arrays, named after the part of the `Slam` and the array in it: `associate.known.landmark`,
`hypotheses.0.ekf.state`. Nothing in the file is executed when it is read.
"""

import json
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from saccade.errors import LogError
from saccade.io.checkpoint import Arrays, checksum
from saccade.io.files import FORMATS, atomic_write, check_format, reading
from saccade.io.npz import read_arrays, save_arrays
from saccade.slam.config import EkfConfig

KIND = "landmark map of saccade slam"
"""What the file says it is."""


def write_map(
    path: str | Path, config: EkfConfig, odometry_bias: tuple[float, float, float], arrays: Arrays
) -> None:
    """Write a map file, whole or not at all.

    Args:
        path: the file.
        config: settings of the filter that made the map.
        odometry_bias: as for `Slam`.
        arrays: state of the parts of the `Slam`, and its `sessions` and `descriptors`.

    Raises:
        OutputError: the file cannot be written.
    """
    arrays = {
        **arrays,
        "kind": np.array(KIND),
        "format": np.array(FORMATS["slam_map"]),
        "config": np.array(json.dumps(asdict(config))),
        "models": np.array(json.dumps({"odometry_bias": odometry_bias})),
    }
    arrays["checksum"] = np.array(checksum(arrays))
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        save_arrays(file, arrays, compressed=False)


def read_map(path: str | Path) -> tuple[EkfConfig, tuple[float, float, float], Arrays]:
    """Read what `write_map` wrote: settings, odometry biases and arrays.

    Raises:
        LogError: it cannot be read, is damaged, no map, or of another version.
    """
    path = Path(path)
    with reading(path, LogError, f"a {KIND}, found no .npz, or a damaged one", ValueError):
        arrays = read_arrays(path)
    if str(arrays.get("kind")) != KIND:
        raise LogError(f"{path}: expected a {KIND}, found another .npz")
    check_format("slam_map", int(arrays["format"]), path, LogError)
    if int(arrays["format"]) < FORMATS["slam_map"]:
        raise LogError(
            f"{path}: expected a {KIND} of format {FORMATS['slam_map']}, found that of a version "
            "before the first release that saves maps; run the log again"
        )
    if str(arrays.pop("checksum", "")) != checksum(arrays):  # kernels trust the shapes of arrays
        raise LogError(f"{path}: expected a {KIND}, found a damaged one")
    settings = json.loads(str(arrays["config"]))
    settings["start_sigma"] = tuple(settings["start_sigma"])
    known = {field.name for field in fields(EkfConfig)}  # those of an older version may be gone
    config = EkfConfig(**{name: value for name, value in settings.items() if name in known})
    distance, turn, loss = json.loads(str(arrays["models"]))["odometry_bias"]
    return config, (distance, turn, loss), arrays
