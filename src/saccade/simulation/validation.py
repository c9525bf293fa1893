"""Range checks of settings."""

from collections.abc import Mapping
from typing import Any

from saccade.errors import require


def require_ranges(config: Any, ranges: Mapping[str, tuple[float, float, str]]) -> None:
    """Check that settings lie within limits.

    Args:
        config: a configuration; settings that are None are not checked.
        ranges: smallest and largest value and the unit, by the name of the setting.

    Raises:
        ConfigError: a setting outside its range.
    """
    for name, (low, high, unit) in ranges.items():
        value = getattr(config, name)
        within = value is None or low <= value <= high
        require(within, name, f"{low:g} to {high:.4g} {unit}".rstrip(), value)
