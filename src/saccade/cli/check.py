"""`saccade check`: diagnostics of a camera drive or a landmark log."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import INPUT, JsonOptions
from saccade.cli.output import Result, Table, progress_bar
from saccade.cli.recordings import KIND, AnyKind, LogOptions, SequenceOptions
from saccade.datasets import load_map
from saccade.datasets.formats import AUTO
from saccade.datasets.recordings import is_log, read_by
from saccade.errors import setting
from saccade.frames import Drive
from saccade.types import LandmarkLog

if TYPE_CHECKING:
    from saccade.diagnostics.findings import Finding


@dataclass(frozen=True, kw_only=True)
class CheckOptions(JsonOptions, LogOptions, SequenceOptions):
    """Options of `saccade check`."""

    kind: Annotated[AnyKind | None, INPUT, KIND] = None
    """Format of SEQUENCE, or module:function that reads it; detected by default."""
    frames: int = setting(300, 40)
    """Number of frames to inspect, evenly spaced over the drive; at least 40."""

    map_file: Annotated[Path | None, INPUT, Parameter("--map")] = None
    """True positions of the tags of --tags, a table of landmarks."""

    def read(self, sequence: Path) -> LandmarkLog | Drive:
        """The recording; --topic reads the landmarks of a bag."""
        kind = self.kind or AUTO
        if ":" in kind:
            return read_by(kind, sequence)
        if not sequence.exists() or not (self.topic or is_log(sequence, kind)):
            return self.load_drive(sequence)
        return self.load(sequence)


Recording: TypeAlias = Annotated[
    Path,
    Parameter(help="Camera drive (a folder, video, bag or track file) or landmark log."),
]


def check(sequence: Recording, /, options: CheckOptions = CheckOptions()) -> Result:
    """Check a camera drive or a landmark log for errors before mapping.

    Drives: compares odometry with visual motion (sign, scale, time offset,
    noise, camera extrinsics), and detects repeated, black, blurred and missing
    frames, and stereo pairs that are not rectified.

    Logs: compares repeated observations of each landmark, given the odometry,
    under alternative units, signs, axes, sensor mountings, orders of motion and
    clocks.

    With --tags: compares the tags in the images with odometry and with the
    survey of --map, to find a wrong tag size, focal length or mounting.

    Exit code 0: no problem found; 1: at least one problem found.

    Example: saccade check kitti/07
    """
    from saccade.diagnostics import check_drive, check_log

    if options.tag_config is not None:
        return _check_tags(sequence, options)
    recording = options.read(sequence)
    if isinstance(recording, LandmarkLog):
        log = recording
        counts = {"poses": len(log.time), "observations": len(log.observation)}
        findings = check_log(log)
        row = {"log": log.name, **counts}
        return _result(log.name, row, f"{counts['observations']:,} observations", findings)
    with progress_bar("checking") as update:
        report = check_drive(recording, options.frames, update)
    row = {"sequence": report.name, "frames": report.frames, "inspected": report.inspected}
    count = f"{report.frames} frames, {report.inspected} inspected"
    result = _result(report.name, row, count, report.findings)
    return Result({**result.row, "figures": report.figures}, result.tables, code=result.code)


def _check_tags(sequence: Path, options: CheckOptions) -> Result:
    """Check the tags of a camera drive, and the calibration of the camera."""
    from saccade.diagnostics import check_log

    survey = None if options.map_file is None else load_map(options.map_file)
    ride = options.load_ride(sequence)
    log = ride.tags.log
    tags, seen = len(set(log.landmark.tolist())), len(log.observation)
    row = {"sequence": log.name, "frames": len(ride.drive), "tags": tags, "observations": seen}
    findings = ride.findings(survey) or check_log(log)  # ranges of a wrong scale mislead it
    count = f"{len(ride.drive)} frames, {seen:,} observations of {tags} tags"
    return _result(log.name, row, count, findings)


def _result(name: str, row: dict[str, Any], count: str, findings: "Sequence[Finding]") -> Result:
    """The findings as a table and as a row; the exit code is 1 if there is a problem."""
    problems = sum(each.severity != "note" for each in findings)
    verdict = f"{problems or 'no'} problem{'' if problems == 1 else 's'}"
    cells = [[f"{each.severity}: {each.check}", str(each)] for each in findings]
    table = Table(f"{name}: {count}, {verdict}", ["", ""], cells)
    row = {**row, "clean": problems == 0, "findings": [asdict(finding) for finding in findings]}
    return Result(row, [table], code=int(problems > 0))
