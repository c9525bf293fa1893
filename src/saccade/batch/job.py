"""A job: what is extracted from every image, and with which configuration."""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import saccade
from saccade.errors import Settings, require, setting
from saccade.keypoints.sift_config import DescriptorConfig, SiftConfig

What: TypeAlias = Literal["saliency", "contrast", "symmetry", "scanpath", "sift", "must", "symroid"]
MapFormat: TypeAlias = Literal["zarr", "png"]

POINTS = ("sift", "must", "symroid")
MAPS = ("saliency", "contrast", "symmetry")
ADDED_SETTINGS: dict[str, dict[str, Any]] = {
    "SiftConfig": {
        "orientation_bins": SiftConfig().orientation_bins,
        "descriptor_dtype": SiftConfig().descriptor_dtype,
        "ranking": "response",
    },
    "MustConfig": {"descriptor": DescriptorConfig()},
}
"""Settings that release 0.1 did not have, and the values by which it worked. At these they are left
out of the description of a job, so that data sets of that release keep their fingerprint."""


@dataclass(frozen=True)
class Job(Settings):
    """Features to extract from every image, and their settings."""

    what: What
    """Detector or model; also the folder of its table."""
    settings: Any
    """The configuration of the algorithm: AttentionConfig or FittedModel for saliency and
    scanpath, ContrastConfig, SymmetryConfig, SiftConfig, MustConfig or SymRoidConfig."""
    network: Any = None
    """ScanpathConfig of a scanpath; None for the default."""
    fixations: int = setting(10, 1)
    """Length of a scanpath."""
    exact: bool = False
    """Keep all bits of points; see `saccade.batch.tables.point_rows`."""
    maps: MapFormat = "zarr"
    """File format of maps."""
    version: str = saccade.__version__
    """Version of this package."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for settings in (self.settings, getattr(self.settings, "descriptor", None)):
            dtype = getattr(settings, "descriptor_dtype", "uint8")
            require(dtype == "uint8", "descriptor_dtype", "uint8, as the table has it", dtype)

    def describe(self) -> dict[str, Any]:
        """All that the result depends on but the version, for JSON."""
        settings = asdict(self.settings)
        for name, value in ADDED_SETTINGS.get(type(self.settings).__name__, {}).items():
            if getattr(self.settings, name) == value:
                del settings[name]
        description: dict[str, Any] = {"what": self.what, "settings": settings}
        if self.what == "scanpath":
            network = None if self.network is None else asdict(self.network)
            description |= {"network": network, "fixations": self.fixations}
        if self.what in POINTS:
            description["exact"] = self.exact
        if self.what in MAPS:
            description["maps"] = self.maps
        return description

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the description, as 16 hexadecimal digits."""
        text = json.dumps(self.describe(), sort_keys=True, default=str)
        return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
