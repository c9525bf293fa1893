"""The maps at full size and the tables of scanpaths that `saccade look` writes.

It imports what writes them when it is needed: without options nothing is written here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saccade.cli.output import relative_names
from saccade.types import FixationTable, Float32Array, FloatArray, Scanpath, ScanpathSamples


class _Path(NamedTuple):
    """A scanpath on an image, as of a viewer."""

    image: str
    viewer: int
    path: Scanpath
    duration: FloatArray


@dataclass(frozen=True)
class LookFiles:
    """Formats of the files, and the scanpaths of the images so far."""

    figures: Sequence[str] = ("png",)
    arrays: bool = True
    """Whether each image has an .npz."""
    tables: Sequence[str] = ()
    """csv or mat."""
    maps: Sequence[str] = ()
    """Of `saccade.exchange.maps.MAP_FORMATS`."""
    paths: dict[Path, tuple[Scanpath, ScanpathSamples]] = field(default_factory=dict)

    def write_maps(self, out: Path, name: str, layers: Mapping[str, Float32Array]) -> list[str]:
        """Write maps (H, W) into a folder for each layer; returns the files."""
        if not self.maps:
            return []
        from saccade.exchange import write_map

        files = [
            (out / "maps" / layer / f"{name}.{kind}", values)
            for kind in self.maps
            for layer, values in layers.items()
        ]
        for path, values in files:
            write_map(path, values)
        return [str(path) for path, _ in files]

    def write_tables(self, out: Path) -> dict[str, str]:
        """Write scanpaths and samples of all images; returns the files."""
        if not self.tables or not self.paths:
            return {}
        from saccade.evaluation.scanpaths import durations_of

        names = relative_names(list(self.paths))
        scans, drawn = [], []
        for path, (scan, samples) in self.paths.items():
            scans.append(_Path(names[path], 0, scan, durations_of(scan)[: len(scan)]))
            drawn += [
                _Path(names[path], number, samples[number], samples.duration[number])
                for number in range(len(samples))
            ]
        files = {}
        for kind in self.tables:
            for stem, paths in (("scanpaths", scans), ("samples", drawn)):
                files[f"{stem}_{kind}"] = str(out / f"{stem}.{kind}")
                _write(out / f"{stem}.{kind}", paths)
        return files


def _write(file: Path, paths: Sequence[_Path]) -> None:
    from saccade.datasets.fixations import write_fixations

    lengths = [len(each.path) for each in paths]
    onset = np.concatenate([each.path.time for each in paths])
    table = FixationTable(
        np.repeat([each.image for each in paths], lengths),
        np.repeat([each.viewer for each in paths], lengths),
        np.concatenate([np.arange(length) for length in lengths]),
        np.concatenate([each.path.xy for each in paths]),
        np.concatenate([each.duration for each in paths]),
    )
    saliency = np.concatenate([each.path.saliency for each in paths])
    write_fixations(file, table, onset_ms=1000 * onset, saliency=saliency)
