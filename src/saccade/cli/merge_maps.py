"""`saccade slam --merge`: maps of several runs as one."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from saccade.cli.output import Result, facts_table, print_message
from saccade.errors import ConfigError, LogError
from saccade.slam import Slam
from saccade.slam.merging import merge_maps


def merge_files(maps: Sequence[Path], out: Path | None, *, anyway: bool) -> Result:
    """Merge map files into `out`, in the frame of the first.

    Raises:
        ConfigError: fewer than two maps, or no output.
        LogError: a map is unreadable, or does not fit the others (see `merge_maps`).
    """
    if out is None or len(maps) < 2:
        raise ConfigError("--merge: expected two maps or more, --save-map, and no LOG")
    slam, merged = Slam.load(maps[0]), list[dict[str, Any]]()
    for path in maps[1:]:
        second = Slam.load(path)
        try:
            result = merge_maps(slam, second, anyway=True)
        except LogError as error:
            raise LogError(f"{path}: {error}") from error
        slam = result.slam
        if slam.warning and not anyway:
            raise LogError(f"{path}: {slam.warning}; check the maps, or merge with --anyway")
        merged.append(
            {
                "map": str(path),
                "common": len(result.common),
                "probability": result.probability,
                "nis_per_dof": result.nis / (2 * len(result.common) - 3),
                "transform": result.transform.tolist(),
                "transform_covariance": result.covariance.tolist(),
            }
        )
    slam.save(out)
    if slam.warning:
        print_message(f"warning: {slam.warning}")
    row = {"map": str(maps[0]), "merged": merged, "landmarks": len(slam.map), "file": str(out)}
    common = ", ".join(str(each["common"]) for each in merged)
    shown = {"landmarks": f"{len(slam.map):,}", "common landmarks": common}
    title = f"{' + '.join(map(str, maps))} -> {out}"
    return Result(row | {"warning": slam.warning}, [facts_table(title, shown)])
