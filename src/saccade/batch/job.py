"""What is to be done with every image."""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import saccade
from saccade.errors import require

What: TypeAlias = Literal["saliency", "contrast", "symmetry", "scanpath", "sift", "must", "symroid"]
Maps: TypeAlias = Literal["zarr", "png"]

POINTS = ("sift", "must", "symroid")
MAPS = ("saliency", "contrast", "symmetry")
ADDED_SETTINGS = {
    "SiftConfig": ("orientation_bins", "descriptor_dtype"),
    "MustConfig": ("descriptor",),
    "SymRoidConfig": ("descriptor",),
}
"""Settings that the first release did not have. At their defaults they are left out of what
describes a job, so that what it extracted is known to be the same."""


@dataclass(frozen=True)
class Job:
    """What to extract, and how."""

    what: What
    """Also the folder of its table."""
    settings: Any
    """The configuration of the algorithm: AttentionConfig for saliency and scanpath,
    ContrastConfig, SymmetryConfig, SiftConfig, MustConfig or SymRoidConfig."""
    network: Any = None
    """ScanpathConfig of a scanpath; None for the default."""
    fixations: int = 10
    """Of a scanpath."""
    exact: bool = False
    """Keep all bits of points; see `saccade.batch.tables.point_table`."""
    maps: Maps = "zarr"
    """Files that maps are written to."""
    version: str = saccade.__version__
    """Of this package."""

    def __post_init__(self) -> None:
        whats = get_args(What)
        require(self.what in whats, "what", f"one of {', '.join(whats)}", self.what)
        require(self.maps in get_args(Maps), "maps", "zarr or png", self.maps)
        require(self.fixations >= 1, "fixations", "1 or more", self.fixations)

    def described(self) -> dict[str, Any]:
        """All that the result depends on but the version, for JSON."""
        settings, default = asdict(self.settings), type(self.settings)()
        for name in ADDED_SETTINGS.get(type(self.settings).__name__, ()):
            if getattr(self.settings, name) == getattr(default, name):
                del settings[name]
        told: dict[str, Any] = {"what": self.what, "settings": settings}
        if self.what == "scanpath":
            network = None if self.network is None else asdict(self.network)
            told |= {"network": network, "fixations": self.fixations}
        if self.what in POINTS:
            told["exact"] = self.exact
        if self.what in MAPS:
            told["maps"] = self.maps
        return told

    @cached_property
    def fingerprint(self) -> str:
        """16 hexadecimal digits of what is `described`."""
        text = json.dumps(self.described(), sort_keys=True, default=str)
        return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
