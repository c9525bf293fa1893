"""A job: the features to extract from every image, and their settings."""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

from saccade.errors import Settings, require, setting

What: TypeAlias = Literal["saliency", "contrast", "symmetry", "scanpath", "sift", "must", "symroid"]

POINTS = ("sift", "must", "symroid")
MAPS = ("saliency", "contrast", "symmetry")


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

    def __post_init__(self) -> None:
        super().__post_init__()
        for settings in (self.settings, getattr(self.settings, "descriptor", None)):
            dtype = getattr(settings, "descriptor_dtype", "uint8")
            require(dtype == "uint8", "descriptor_dtype", "uint8, as the table has it", dtype)

    def describe(self) -> dict[str, Any]:
        """All settings that the result depends on, for JSON."""
        description: dict[str, Any] = {"what": self.what, "settings": asdict(self.settings)}
        if self.what == "scanpath":
            network = None if self.network is None else asdict(self.network)
            description |= {"network": network, "fixations": self.fixations}
        return description

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the description, as 16 hexadecimal digits."""
        text = json.dumps(self.describe(), sort_keys=True, default=str)
        return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
