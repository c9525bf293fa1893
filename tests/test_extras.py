"""The hint where an optional dependency is missing."""

import pytest

from saccade.errors import ConfigError
from saccade.extras import import_optional


def test_a_missing_library_is_named_with_its_extra():
    expected = (
        "hdf5: needs no_such_library, which is not installed; "
        "pip install 'pysaccade[hdf5]', or in a clone: uv sync --extra hdf5"
    )
    with pytest.raises(ConfigError) as refused:
        import_optional("no_such_library", "hdf5")
    assert str(refused.value) == expected
