"""`saccade slam`: EKF-SLAM over a landmark log."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from saccade.cli.mapping import (
    RunOutput,
    pose_table,
    run_facts,
    time_charts,
    write_files,
    write_film,
    write_run,
)
from saccade.cli.options import (
    MAP,
    Options,
    OutputFolder,
    SettingsOptions,
)
from saccade.cli.output import (
    Progress,
    Result,
    facts_table,
    print_message,
    progress_bar,
)
from saccade.cli.recordings import LogOptions, TagRide, parse_pose
from saccade.datasets import load_map, symmetric_columns, write_landmarks, write_table, write_tum
from saccade.diagnostics.landmark_log import check_log
from saccade.diagnostics.slam_run import check_run
from saccade.errors import ConfigError, LogError
from saccade.evaluation.runs import lost_times, summarize_run
from saccade.extras import import_function
from saccade.io.files import results_in
from saccade.landmark_names import name_texts
from saccade.plane import in_robot_frame
from saccade.slam import (
    EkfConfig,
    Slam,
    SlamResult,
    dead_reckon,
    run,
)
from saccade.slam.association.rules import RULES, Pairing
from saccade.slam.run import find_start, slam_for
from saccade.types import (
    FloatArray,
    LandmarkLog,
    LandmarkMap,
    MapSnapshot,
)
from saccade.viewing import map_figure, map_frames
from saccade.viewing.page import Section
from saccade.viewing.report import Part, ReportBuilder
from saccade.viewing.report_map import ObservedLandmarks, map_part

RULES_HELP = (
    f"Data association: {'; '.join(f'{name}, {rule.summary}' for name, rule in RULES.items())}; "
    "or module:function, which pairs observations with landmarks."
)
"""Help of --association."""


def _rule(name: str) -> str | Pairing:
    """A rule by its name, or module:function."""
    return import_function("association", name) if ":" in name else name


@dataclass(frozen=True)
class LogArgument(Options):
    """A landmark log."""

    log: Path
    """Landmark log: a file, folder or ROS bag."""


@dataclass(frozen=True, kw_only=True)
class SlamOptions(SettingsOptions, LogOptions, RunOutput, LogArgument):
    """Options of `saccade slam`."""

    out: OutputFolder = Path("saccade-slam")
    association: Annotated[str | None, Parameter(metavar="NAME", help=RULES_HELP)] = None
    no_smooth: Annotated[bool, Parameter(negative=())] = False
    """Keep the filtered trajectory and map, without smoothing at the end."""
    map_file: Annotated[Path | None, MAP, Parameter("--map")] = None
    """Start from a map: of an earlier run (.npz), or a table of landmarks (.csv)."""
    save_map: Annotated[Path | None, MAP] = None
    """Save the map and the filter, for --map of a later run."""
    mode: Annotated[Literal["continue", "localize"], MAP] = "continue"
    """Use of --map: continue mapping, or localize without adding or culling landmarks."""
    start: Annotated[str | None, MAP, Parameter(metavar="WHERE")] = None
    """First pose in the frame of --map. last: the robot has not moved since (default for continue,
    unless the first scans contradict it); search: from the first scans (default for localize and
    .csv maps); log: as in the log; or X,Y,HEADING in meters and radians."""

    @property
    def first(self) -> str:
        """Source of the first pose."""
        searched = self.mode == "localize" or self.has_survey
        return self.start or ("search" if searched else "last")

    @property
    def has_survey(self) -> bool:
        """Whether the map is a table of landmarks."""
        return self.map_file is not None and self.map_file.suffix.lower() == ".csv"

    @property
    def survey(self) -> LandmarkMap | None:
        """The map, if it is a table of landmarks."""
        return load_map(self.map_file) if self.map_file is not None and self.has_survey else None

    def filter_of(self, log: LandmarkLog) -> Slam:
        """The filter for a log; --map supplies the map, and the settings unless others are given.

        Raises:
            ConfigError, LogError: as `Slam.load` and `find_start`, or --start is malformed.
        """
        settings: EkfConfig = self.settings("slam")
        if self.association is not None:
            settings = replace(settings, association=_rule(self.association))
        if self.no_smooth:
            settings = replace(settings, smooth=False)
        if self.map_file is None:
            return slam_for(log, settings)
        if self.mode == "localize" and self.save_map is not None:
            raise ConfigError("--save-map: expected --mode continue, found localize")
        given = any(each is not None for each in (self.association, self.preset, self.config))
        own = settings if given else None
        load: Callable[..., Slam] = partial(Slam.load, self.map_file, self.mode, own)
        if self.has_survey:
            if self.first == "last":
                raise ConfigError("--start: expected search, log or X,Y,HEADING with a .csv map")
            load = partial(_surveyed, settings, load_map(self.map_file), self.mode)
        elif self.first == "last":
            robot = load()
            robot.start = "last" if self.start is None else "given"
            return robot
        load = partial(load, odometry_bias=log.odometry_bias)
        pose, covariance = _first_pose(load(start=log.start), log, self.first)
        return load(start=pose, covariance=covariance)


def slam(options: SlamOptions) -> Result:
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
    ride = None if options.tag_config is None else options.load_ride(options.log)
    log = in_robot_frame(options.load(options.log)) if ride is None else ride.tags.log
    with results_in(options.out), progress_bar(log.name) as progress:
        row = map_log(log, options, progress, ride=ride)
    if row["warning"]:
        print_message(f"warning: {row['warning']}")
    if row["remark"]:
        print_message(row["remark"])
    shown = run_facts({**row, "warning": ""})  # it is printed above
    return Result(row, [facts_table(f"{log.name} -> {options.out}", shown)])


LEAD = "The trajectory of a robot and the map of its landmarks, filtered and smoothed."


def map_log(
    log: LandmarkLog,
    options: SlamOptions,
    progress: Progress,
    report: ReportBuilder | None = None,
    ride: TagRide | None = None,
) -> dict[str, Any]:
    """Run the filter over a log, write the results, and return the content of run.json.

    The run is added to `report`; None writes a report for this run alone. `ride` is the camera
    drive of a log of tags.
    """
    causes = check_log(log)
    out, slam = options.out, options.filter_of(log)
    try:
        odometry, filtered = dead_reckon(log, slam.config), partial(progress, stage="filter")
        with options.recorder(log.name, log.time, odometry) as recorder:
            result = run(log, progress=filtered, recorder=recorder, initial=slam)
    except (LogError, ArithmeticError, np.linalg.LinAlgError) as error:
        known = isinstance(error, LogError)
        if not causes and not known:
            raise
        why = error if known else "The estimate diverged"
        raise LogError(f"{log.name}: {' '.join(map(str, causes[:1]))} {why}") from error
    smoothed = result.estimate == "smoothed"
    tables: dict[str, tuple[Callable[..., Any], Any]] = {
        "trajectory.tum": (write_tum, result.trajectory),
        "poses.csv": (write_table, pose_table(result.trajectory)),
        "landmarks.csv": (write_landmarks, result.map),
        "innovations.csv": (write_table, innovation_table(log, result)),
    }
    tables |= {"filtered.tum": (write_tum, result.filtered)} if smoothed else {}
    files = write_files(out, tables)
    figure = map_figure(
        result.trajectory,
        result.map,
        result.dead_reckoning,
        truth=log.aligned_truth,
        landmark_truth=log.landmark_truth,
        filtered=result.filtered if smoothed else None,
        lost=result.lost,
    )
    files["picture"] = options.save_figure(figure, "map")
    snapshots = recorder.snapshots
    if options.film:
        frames = map_frames(snapshots, log.time, odometry)
        files |= write_film(out / "map.mp4", frames, len(snapshots), progress)
    if options.save_map is not None:
        slam.save(options.save_map)
        files["map"] = options.save_map
    findings = list(check_run(log, result, causes))
    if ride is not None:
        findings += ride.findings(options.survey)
    summary = summarize_run(log, result) | _map_figures(options, slam, result)
    found = filter(None, (*map(str, findings), summary["warning"]))
    summary |= {"warning": " ".join(found), "findings": [asdict(each) for each in findings]}
    return write_run(
        out,
        f"saccade slam: {log.name}",
        LEAD,
        lambda: slam_part(log, result, snapshots, summary, _num_loaded(slam), ride),
        files,
        {**summary, "settings": asdict(slam.config)},
        report,
    )


def _num_loaded(slam: Slam) -> int:
    """Smallest id of the landmarks added in this session."""
    counts = slam.landmarks.counts
    return int(counts.id[counts.session < slam.landmarks.session].max(initial=-1)) + 1


def _map_figures(options: SlamOptions, slam: Slam, result: SlamResult) -> dict[str, Any]:
    """Numbers of observed loaded landmarks and of new landmarks, for run.json."""
    observations = result.map.observations
    if options.map_file is None or result.session is None or observations is None:
        return {"map": None}
    loaded = result.session < slam.landmarks.session
    return {
        "map": str(options.map_file),
        "map_landmarks": int(loaded.sum()),
        "map_landmarks_observed": int((observations[loaded] > 0).sum()),
        "map_landmarks_new": int((~loaded).sum()),
    }


def innovation_table(log: LandmarkLog, result: SlamResult) -> dict[str, np.ndarray[Any, Any]]:
    """Observations with innovations, as columns; NaN for unused observations."""
    landmark = np.append(result.map.id, -1)[result.association]
    return {
        "pose": log.observation_pose,
        "time": log.time[log.observation_pose],
        "landmark": name_texts(landmark, result.map.text_names),
        "range": log.observation[:, 0],
        "bearing": log.observation[:, 1],
        "innovation_1": result.innovation[:, 0],
        "innovation_2": result.innovation[:, 1],
        **symmetric_columns(("1", "2"), result.innovation_covariance),
        "nis": result.consistency.nis,
    }


SLAM_TEXT = (
    "The ellipses enclose 3 sigma (99.7 %). Scrub through the drive or play it; click a "
    "landmark to see the poses from which it was observed; click a chart to go to that time."
)
REOBSERVED = 2
"""Kind of an observation of a landmark that is in the map; see `ObservedLandmarks`."""
LOADED = " Blue landmarks belong to the loaded map, black landmarks are new."


def slam_part(
    log: LandmarkLog,
    result: SlamResult,
    snapshots: Sequence[MapSnapshot],
    summary: Mapping[str, Any],
    loaded: int,
    ride: TagRide | None = None,
) -> Part:
    """The map of a log as a part of a report; landmarks with an id below `loaded` were loaded."""
    truth = log.aligned_truth
    trajectories = {"estimate": result.filtered, "odometry": result.dead_reckoning}
    trajectories |= {} if truth is None else {"truth": truth}
    trajectories |= {"smoothed": result.trajectory} if result.estimate == "smoothed" else {}
    used, ids = result.association >= 0, result.ids
    texts = result.map.text_names and dict(
        zip(ids.tolist(), map(str, result.map.names), strict=True)
    )
    observed = ObservedLandmarks(log.observation_pose[used], ids[result.association[used]])
    if ride is not None:
        kind = np.full(len(observed.id), REOBSERVED)
        kind[np.unique(observed.id, return_index=True)[1]] = 0
        observed = replace(observed, xy=ride.tags.xy[used], kind=kind)
    return map_part(
        Section(
            f"{log.name}: the growing map",
            SLAM_TEXT + LOADED * (loaded > 0),
            facts=run_facts(summary),
        ),
        trajectories,
        snapshots,
        observed,
        time_charts(
            result.trajectory,
            log.aligned_truth,
            log.observation_pose,
            result.innovation,
            result.innovation_covariance,
            result.consistency.dof,
        ),
        log.landmark_truth,
        image_at=None if ride is None else ride.image_at,
        loaded=loaded,
        lost=lost_times(result.trajectory, result.lost),
        names=texts or None,
    )


def _surveyed(
    settings: EkfConfig,
    landmarks: LandmarkMap,
    mode: Literal["continue", "localize"],
    *,
    start: FloatArray,
    odometry_bias: tuple[float, float, float],
    covariance: FloatArray | None = None,
) -> Slam:
    """A filter that starts from a surveyed map, as `Slam.load` from a saved map."""
    robot = Slam(settings, start=start, odometry_bias=odometry_bias, mode=mode, map=landmarks)
    if covariance is not None:
        robot.filter.reset_pose(start, covariance)
    return robot


def _first_pose(slam: Slam, log: LandmarkLog, start: str) -> tuple[FloatArray, FloatArray | None]:
    """First pose in the map frame, with its covariance; None for the covariance of `Slam.load`."""
    if start == "search":
        return find_start(slam, log)
    if start == "log":
        return log.start, np.diag(np.square(slam.config.start_sigma))
    return np.array(parse_pose("--start", start, "last, search, log or X,Y,HEADING")), None
