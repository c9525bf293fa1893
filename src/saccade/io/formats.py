"""Format versions of the files that this package writes and reads.

A change to a format adds 1 here, and files of the older versions must stay readable:
`tests/data/release-0.1` has one of each. Text files with named columns or settings (CSV, TOML, g2o)
have no version.
"""

FORMATS = {
    "run": 1,  # run.json of `saccade slam` and `saccade drive`
    "map": 1,  # map.npz of `saccade drive`
    "look": 1,  # NAME.look.npz of `saccade look`
    "slam_map": 2,  # of `Slam.save` and `saccade slam --save-map`
    "checkpoint": 8,  # of an interrupted run; other versions are ignored
    "points": 1,  # of an image: .npz; of many: .parquet, .h5
    "extraction": 1,  # the folder of `saccade extract`: in manifest.json, for all files
    "index": 1,  # the index of `saccade find`: in images.json, for all files
}
"""Current versions by name; older ones are read too."""


def check_format(name: str, version: object, path: object, error: type[Exception]) -> None:
    """Refuse files of a later version of this package.

    Args:
        name: one of `FORMATS`.
        version: in the file; None if it has none, as files of other programs.
        path: of the file.
        error: exception to raise.
    """
    known = FORMATS[name]
    if version is None:
        return
    if not isinstance(version, int) or version < 1:
        raise error(f"{path}: expected a format from 1 to {known}, found {version!r}")
    if version > known:
        raise error(
            f"{path}: expected a format up to {known}, found {version}: a later version of saccade "
            "has written it; upgrade this one"
        )
