"""A job: the features to extract from every image, and their settings."""

import hashlib
import inspect
import json
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from saccade.attention.models import MODELS
from saccade.batch.stored import stamp_of_file
from saccade.errors import Settings, require, setting
from saccade.extras import name_of
from saccade.io.masks import check_masks
from saccade.keypoints.detectors import DETECTORS, OWN, own_function

SALIENCY = "saliency"
"""Name of the maps of the attention model."""
SCANPATH = "scanpath"
FROM_FILE = "points"
"""Name of keypoints that a file of features has."""
MAPS = tuple(SALIENCY if name == "attention" else name for name in MODELS)
"""Saliency models that can be extracted."""
ATTENTION = (SALIENCY, SCANPATH)
"""Features of the attention model, or of a fitted model."""


def features() -> list[str]:
    """Names of the features, besides those of users' functions."""
    return [*DETECTORS, *MAPS, SCANPATH]


@dataclass(frozen=True)
class Job(Settings):
    """Features to extract from every image, and their settings."""

    what: str | Callable[..., Any]
    """A name in `features()`; `FROM_FILE` for the keypoints of `file`; or a function, or its name
    as module:function, from an image to points as for `saccade.keypoints.detectors.make_detector`,
    or to a map (h, w) in [0, 1]."""
    settings: Any = None
    """The configuration of the algorithm, or the `FittedModel` of saliency and scanpath; None for
    the default, and for a function."""
    network: Any = None
    """ScanpathConfig of a scanpath; None for the default."""
    fixations: int = setting(10, 1)
    """Length of a scanpath."""
    stretch: bool = False
    """Whether the contrast of each image is stretched; see `saccade.stretch_contrast`."""
    masks: str | None = None
    """Folder with a mask NAME.png for images NAME, whose points are kept where it is not black;
    images without one are used whole. Of points only."""
    file: str | None = None
    """File of features by the names of the images, for `FROM_FILE`: HDF5 as
    `saccade.exchange.write_hdf5` and hloc write it, or a database of COLMAP."""

    def __post_init__(self) -> None:
        super().__post_init__()
        known = not self.is_own or not isinstance(self.what, str) or ":" in self.what
        require(known, "what", f"one of {', '.join(features())} or {OWN}", self.what)
        require(
            self.has_points or self.masks is None, "masks", "interest points with masks", self.what
        )
        is_file = self.what == FROM_FILE
        require(is_file or self.file is None, "file", f"{FROM_FILE} with a file", self.what)
        require(not (is_file and self.stretch), "stretch", "no stored points", True)
        if self.file is not None:
            stamp_of_file(Path(self.file))  # fails without a file
        check_masks(None if self.masks is None else Path(self.masks))
        if self.is_own:
            require(self.settings is None, "settings", "none for a function", self.settings)
        elif self.settings is None and self.what in DETECTORS:
            object.__setattr__(self, "settings", DETECTORS[str(self.what)].settings())

    @property
    def is_own(self) -> bool:
        """Whether the features are those of a user's function."""
        return self.what not in (*features(), FROM_FILE)

    @property
    def has_points(self) -> bool:
        """Whether the features are points, or those of a user's function."""
        return self.what not in (*MAPS, SCANPATH)

    @property
    def folder(self) -> str:
        """Name of the folder of the table."""
        return re.sub(r"[^\w.-]", ".", name_of(self.what))

    def describe(self) -> dict[str, Any]:
        """All settings that the result depends on, for JSON; of a function its source."""
        settings = None if self.settings is None else asdict(self.settings)
        if self.is_own:
            settings = {"source": source_of(own_function(self.what))}
        description: dict[str, Any] = {"what": name_of(self.what), "settings": settings}
        if self.what == SCANPATH:
            network = None if self.network is None else asdict(self.network)
            description |= {"network": network, "fixations": self.fixations}
        if self.stretch:
            description["stretch"] = True
        if self.file is not None:
            description["settings"] = {"file": stamp_of_file(Path(self.file))}
        if self.masks is not None:
            description["masks"] = stamps_of(Path(self.masks))
        return description

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the description, as 16 hexadecimal digits."""
        text = json.dumps(self.describe(), sort_keys=True, default=str)
        return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def stamps_of(folder: Path) -> str:
    """Hash of the names, sizes and times of the files of a folder."""
    files = sorted(each for each in folder.rglob("*.png") if each.is_file())
    lines = [f"{each} {each.stat().st_size} {each.stat().st_mtime_ns}" for each in files]
    return hashlib.blake2b("\n".join(lines).encode(), digest_size=8).hexdigest()


def source_of(function: Callable[..., Any]) -> str:
    """Hash of the source of a function; empty where Python has none."""
    try:
        text = inspect.getsource(function if inspect.isroutine(function) else type(function))
    except (OSError, TypeError):
        return ""
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
