"""`saccade merge-maps`: maps of several runs or robots as one."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from saccade.cli.options import Json

MapPaths = Annotated[
    list[Path],
    Argument(metavar="MAP...", help="Map files of saccade slam --save-map, two or more."),
]


def merge_maps(
    maps: MapPaths,
    out: Annotated[Path, Option("--out", "-o", metavar="FILE", help="Map file to write.")],
    min_common: Annotated[
        int, Option(min=2, help="Landmarks that two maps must have in common.")
    ] = 5,
    as_json: Json = False,
) -> None:
    """Merge maps of the same landmarks, in the frame of the first.

    Common landmarks are found by their names or, without, by their mutual
    distances. FILE is for saccade slam --map.
    """
    from saccade.cli.output import print_result
    from saccade.errors import ConfigError, LogError
    from saccade.slam import MergeConfig, Slam
    from saccade.slam.merging import merge_maps as merge

    if len(maps) < 2:
        raise ConfigError(f"MAP: expected two or more, found {len(maps)}")
    slam, merged = Slam.load(maps[0], "continue"), []
    for path in maps[1:]:
        try:
            result = merge(slam, Slam.load(path, "continue"), MergeConfig(min_common))
        except LogError as error:
            raise LogError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error
        slam = result.slam
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
    row = {"map": str(maps[0]), "merged": merged, "landmarks": len(slam.ekf), "file": str(out)}
    common = ", ".join(str(each["common"]) for each in merged)
    facts = {"landmarks": f"{len(slam.ekf):,}", "common landmarks": common}
    print_result(row, as_json, f"{' + '.join(map(str, maps))} -> {out}", facts)
