"""What wrote the files beside it, with saccade 0.1.0.

Not to be run again: the files are what the first release wrote, and later ones must read them.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

from saccade.batch.engines import Here  # noqa: E402
from saccade.batch.index import build_index  # noqa: E402

from fuzz.targets import a_log, points  # noqa: E402
from saccade import SiftConfig, exchange  # noqa: E402
from saccade.batch import Job, extract, open_source  # noqa: E402
from saccade.datasets import save  # noqa: E402
from saccade.datasets.drives.calibration import Calibration, write_calibration  # noqa: E402
from saccade.frames import Camera  # noqa: E402
from saccade.settings import as_toml  # noqa: E402


def main() -> None:
    """Write all of them."""
    exchange.write_npz(HERE / "points.npz", points())
    exchange.write_csv(HERE / "points.csv", points())
    exchange.write_hdf5(HERE / "points.h5", {"a.png": points()})
    exchange.write_parquet(HERE / "points.parquet", {"a.png": points()})
    for name in ("log.csv", "log.g2o", "log.isam", "log.graph"):
        save(HERE / name, a_log())
    camera = Camera(width=32, height=24, fx=20.0, fy=20.0, cx=16.0, cy=12.0, baseline=0.2)
    write_calibration(HERE / "camera.toml", Calibration(camera))
    (HERE / "sift.toml").write_text(as_toml(SiftConfig.lowe2004()))
    (HERE / "photos").mkdir(exist_ok=True)
    disk = np.zeros((64, 96), np.uint8)
    cv2.circle(disk, (40, 30), 6, 255, -1)
    cv2.imwrite(str(HERE / "photos" / "disk.png"), cv2.GaussianBlur(disk, (0, 0), 2))
    source = open_source(str(HERE / "photos"))
    extract(source, Job("sift", SiftConfig()), str(HERE / "extracted"), Here())
    build_index(HERE / "extracted")


if __name__ == "__main__":
    main()
