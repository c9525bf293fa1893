"""The hint where an optional dependency is missing."""

import pytest

from saccade.errors import ConfigError
from saccade.extras import import_optional


def test_a_missing_library_is_named_with_its_extra():
    expected = "hdf5: needs no_such_library, which is not installed; uv sync --extra hdf5"
    with pytest.raises(ConfigError, match=f"^{expected}$"):
        import_optional("no_such_library", "hdf5")
