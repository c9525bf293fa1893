"""`saccade merge`: maps of several runs as one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import OUTPUT, JsonOptions
from saccade.cli.output import Result, facts_table, print_message
from saccade.errors import LogError, require


@dataclass(frozen=True, kw_only=True)
class MergeOptions(JsonOptions):
    """Options of `saccade merge`."""

    out: Annotated[Path, OUTPUT, Parameter(("--out", "-o"), metavar="FILE")]
    """Merged map (.npz)."""
    anyway: Annotated[bool, Parameter(negative=())] = False
    """Merge even maps that contradict each other or have a warning."""


Maps: TypeAlias = Annotated[
    Path,
    Parameter(help="Maps of saccade slam --save-map (.npz), at least two.", required=True),
]


def merge(*maps: Maps, options: MergeOptions) -> Result:
    """Merge maps of several runs into one, in the frame of the first.

    The common landmarks are found by their labels or, without labels, by their
    mutual distances. saccade slam --map continues with the merged map.

    Example: saccade merge monday.npz tuesday.npz --out both.npz
    """
    from saccade.slam import Slam
    from saccade.slam.merging import merge_maps

    out, anyway = options.out, options.anyway
    require(len(maps) > 1, "MAPS", "two maps or more", len(maps))
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
