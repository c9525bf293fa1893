"""hloc's own readers, which the package deep-image-matching holds; hloc is not on PyPI."""

import importlib
import importlib.util
import sys
from pathlib import Path

import pytest

from saccade.errors import ConfigError
from saccade.exchange.colmap import import_pycolmap


def import_hloc(module):
    """A module of hloc, installed by itself or with deep-image-matching."""
    try:
        import_pycolmap()  # which hloc imports
    except ConfigError as error:
        pytest.skip(str(error))
    if importlib.util.find_spec("hloc") is None:
        holder = importlib.util.find_spec("deep_image_matching")
        if holder is None:
            pytest.skip("hloc, the peer, is not installed")
        sys.path.append(str(Path(holder.origin).parent / "thirdparty"))
    return importlib.import_module(f"hloc.{module}")
