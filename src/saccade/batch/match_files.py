"""The files of hloc and COLMAP with the features and matches of many images."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, TypeAlias

from saccade.batch.dataset import read_points
from saccade.batch.match_shards import MatchedPair
from saccade.batch.pairs import write_pairs
from saccade.exchange import write_colmap, write_hdf5, write_hloc_matches
from saccade.exchange.colmap import import_pycolmap
from saccade.extras import import_optional
from saccade.files import atomic_write

Format: TypeAlias = Literal["hdf5", "colmap"]


def require_libraries(formats: Sequence[str]) -> None:
    """Import the libraries of the formats, to fail before any work is done.

    Raises:
        ConfigError: one is not installed.
    """
    if "colmap" in formats:
        import_pycolmap()
    if "hdf5" in formats:
        import_optional("h5py", "hdf5")


def write_files(
    out: Path, features: str, matched: Sequence[MatchedPair], formats: Sequence[Format]
) -> dict[str, Path]:
    """Write pairs.txt, pairs.csv and the files of the formats; returns them by name.

    Args:
        out: folder.
        features: location of the data set of keypoints.
        matched: the matches.
        formats: hdf5 (features.h5 and matches.h5, as hloc reads them) or colmap (database.db).
    """
    names = {name for each in matched for name in each.pair}
    images = {image.image: image for image in read_points(features) if image.image in names}
    points = {name: image.points for name, image in images.items()}
    shapes = {name: image.shape for name, image in images.items()}
    matches = {each.pair: each.indices for each in matched}
    files = {"pairs": out / "pairs.txt", "table": out / "pairs.csv"}
    write_pairs(files["pairs"], list(matches))
    _write_table(files["table"], matched)
    if "hdf5" in formats:
        files |= {"features": out / "features.h5", "matches": out / "matches.h5"}
        write_hdf5(files["features"], points, shapes)
        counts = {name: len(each) for name, each in points.items()}
        similarities = {each.pair: each.similarity for each in matched}
        write_hloc_matches(files["matches"], matches, counts, similarities)
    if "colmap" in formats:
        files["database"] = out / "database.db"
        verified = {each.pair: each.verification for each in matched}
        geometries = {pair: each for pair, each in verified.items() if each is not None}
        write_colmap(files["database"], points, shapes, matches, geometries)
    return files


def _write_table(path: Path, matched: Sequence[MatchedPair]) -> None:
    """Write the numbers of matches and inliers of each pair."""
    with (
        atomic_write(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["first", "second", "matches", "inliers"])
        for each in matched:
            verified = each.verification
            inliers = "" if verified is None else int(verified.inliers.sum())
            writer.writerow([*each.pair, len(each.indices), inliers])
