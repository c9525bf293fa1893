"""`saccade slam`: EKF-SLAM over a landmark log."""

from pathlib import Path
from typing import Annotated, TypeAlias

from cyclopts import Parameter

from saccade.cli.output import Result, facts_table, print_message, progress_bar
from saccade.cli.slam_options import SlamOptions

Log: TypeAlias = Annotated[
    Path, Parameter(help="Landmark log: a file, folder or ROS bag; with --tags a camera drive.")
]


def slam(log: Log, /, options: SlamOptions = SlamOptions()) -> Result:
    """Map the landmarks of a recorded log: extended Kalman filter, then smoothing.

    Writes to --out the trajectory (trajectory.tum, for evo; poses.csv with
    covariances; filtered.tum before smoothing), the landmarks with covariances
    (landmarks.csv), the innovations (innovations.csv), a figure (map.png), an
    interactive report (report.html), and settings and scores (run.json); with
    --film also a film (map.mp4).

    --map also restores the settings of the map unless others are given. With
    --tags, LOG is a camera drive with odometry, whose tags are the landmarks.

    Example: saccade slam victoria_park.txt --out mapped
    """
    from saccade.cli.mapping import run_facts
    from saccade.cli.slam_run import map_log
    from saccade.io.files import check_writable, results_in
    from saccade.plane import in_robot_frame

    if options.save_map is not None:
        check_writable(options.save_map)
    ride = None if options.tag_config is None else options.load_ride(log)
    loaded = in_robot_frame(options.load(log)) if ride is None else ride.tags.log
    with results_in(options.out), progress_bar(loaded.name) as progress:
        row = map_log(loaded, options, progress, ride=ride)
    if row["warning"]:
        print_message(f"warning: {row['warning']}")
    if row["remark"]:
        print_message(row["remark"])
    shown = run_facts({**row, "warning": ""})  # it is printed above
    return Result(row, [facts_table(f"{loaded.name} -> {options.out}", shown)])
