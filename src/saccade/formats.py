"""The versions of the files that are read again: one place to look at before one is changed.

Whoever changes what such a file means adds 1 here and goes on reading what was written before:
`tests/data/release-0.1` has a file of each. Text whose columns or settings have names (CSV, TOML,
g2o) says what it holds and has no version.
"""

FORMATS = {
    "run": 1,  # run.json of `saccade slam` and `saccade drive`
    "map": 1,  # map.npz of `saccade drive`
    "look": 1,  # NAME.look.npz of `saccade look`
    "checkpoint": 4,  # of an interrupted run; another version begins anew
    "points": 1,  # of an image: .npz; of many: .parquet, .h5
    "extraction": 1,  # the folder of `saccade extract`: manifest.json speaks for all of it
    "index": 1,  # the index of `saccade index`: images.json speaks for all of it
}
"""By name, the version that is written; older ones are read too."""


def check_format(name: str, found: object, place: object, error: type[Exception]) -> None:
    """Refuse what a later version of this package has written.

    Args:
        name: one of `FORMATS`.
        found: what the file says; None where it says nothing, as other programs' files.
        place: the file.
        error: what to raise.
    """
    known = FORMATS[name]
    if found is None:
        return
    if not isinstance(found, int) or found < 1:
        raise error(f"{place}: expected a format from 1 to {known}, found {found!r}")
    if found > known:
        raise error(
            f"{place}: expected a format up to {known}, found {found}: a later version of saccade "
            "has written it; upgrade this one"
        )
