"""The formats of landmark logs."""

from pathlib import Path

from saccade.datasets.formats import Format, first_lines
from saccade.datasets.logs.freiburg import SENSOR, read_freiburg
from saccade.datasets.logs.log_csv import LOG_FILE, is_log_csv, read_log_csv, write_log_csv
from saccade.datasets.logs.mrclam import BARCODES_FILE, read_mrclam
from saccade.datasets.logs.pose_graph import FIELDS, read_pose_graph, write_g2o
from saccade.datasets.ros.bags import BAG_SUFFIXES, is_bag
from saccade.datasets.ros.logs import read_rosbag_log


def _has_word(path: Path, words: set[str] | dict[str, int]) -> bool:
    """Whether a line of a text file begins with one of the words."""
    return any(line.split()[0] in words for line in first_lines(path) if line.strip())


LOG_FORMATS = {
    "csv": Format(
        read_log_csv,
        suffixes=(".csv",),
        files=(LOG_FILE,),
        recognizes=lambda path: path.is_dir() or is_log_csv(path),
        write=write_log_csv,
    ),
    "mrclam": Format(read_mrclam, suffixes=(".npz",), files=(BARCODES_FILE,)),
    "rosbag": Format(read_rosbag_log, suffixes=BAG_SUFFIXES, recognizes=is_bag),
    "freiburg": Format(read_freiburg, recognizes=lambda path: _has_word(path, {SENSOR})),
    "g2o": Format(read_pose_graph, suffixes=(".g2o",), write=write_g2o),
    "isam": Format(
        read_pose_graph,
        suffixes=(".isam", ".graph"),
        recognizes=lambda path: _has_word(path, FIELDS),
    ),
}
"""Formats of landmark logs by name, in the order in which they are recognized."""
