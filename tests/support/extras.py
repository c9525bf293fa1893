"""Functions that need an extra; a test that calls one is skipped where the extra is missing."""

import pytest


def open_source(source):
    """The images of a source, by the extra `parquet`."""
    pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    from saccade.batch import open_source as opened

    return opened(source)
