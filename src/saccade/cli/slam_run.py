"""The run of `saccade slam`: the filter, its files and its report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from saccade.cli.mapping import (
    pose_table,
    run_facts,
    time_charts,
    write_files,
    write_film,
    write_run,
)
from saccade.cli.output import (
    Progress,
)
from saccade.cli.recordings import TagRide, parse_pose
from saccade.cli.slam_options import SlamOptions
from saccade.datasets import load_map, symmetric_columns, write_landmarks, write_table, write_tum
from saccade.diagnostics.landmark_log import check_log
from saccade.diagnostics.slam_run import check_run
from saccade.diagnostics.truth import with_usable_truth
from saccade.errors import ConfigError, LogError
from saccade.evaluation.runs import lost_times, summarize_run
from saccade.landmark_names import name_texts
from saccade.slam import EkfConfig, Slam, SlamResult, dead_reckon
from saccade.slam.recorded_log import find_start, run, slam_for
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
from saccade.viewing.snapshots import at_end

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
    causes = [each for each in check_log(log) if each.severity != "note"]
    log = with_usable_truth(log)
    out, slam = options.out, filter_of(options, log)
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
    snapshots = at_end(recorder.snapshots, result.ids)
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
    notes = [each.what for each in findings if each.severity == "note"]
    found = [str(each) for each in findings if each.severity != "note"]
    summary |= {
        "warning": " ".join(filter(None, (*found, summary["warning"]))),
        "remark": "; ".join(filter(None, (*notes, summary["remark"]))),
        "findings": [asdict(each) for each in findings],
    }
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


def filter_of(options: SlamOptions, log: LandmarkLog) -> Slam:
    """The filter for a log; --map supplies the map, and the settings unless others are given.

    Raises:
        ConfigError, LogError: as `Slam.load` and `find_start`, or --start is malformed.
    """
    settings: EkfConfig = options.settings("slam")
    if options.association is not None:
        settings = replace(settings, association=options.association)
    if options.no_smooth:
        settings = replace(settings, smooth=False)
    if options.map_file is None:
        return slam_for(log, settings)
    if options.mode == "localize" and options.save_map is not None:
        raise ConfigError("--save-map: expected --mode continue, found localize")
    given = any(each is not None for each in (options.association, options.preset, options.config))
    own = settings if given else None
    load: Callable[..., Slam] = partial(Slam.load, options.map_file, options.mode, own)
    if options.has_survey:
        if options.first == "last":
            raise ConfigError("--start: expected search, log or X,Y,HEADING with a survey")
        load = partial(_surveyed, settings, load_map(options.map_file), options.mode)
    elif options.first == "last":
        robot = load()
        robot.start = "last" if options.start is None else "given"
        return robot
    load = partial(load, odometry_bias=log.odometry_bias)
    pose, covariance = _first_pose(load(start=log.start), log, options.first)
    return load(start=pose, covariance=covariance)
