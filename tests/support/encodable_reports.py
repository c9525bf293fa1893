"""A pytest plugin that escapes lone surrogates in test reports.

pytest-xdist sends reports as UTF-8: one lone surrogate in a failure ended the whole run.
"""

from typing import Any

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_report_to_serializable():
    """Escape what cannot be encoded, wherever in the report it stands."""
    return encodable((yield))


def encodable(value: Any) -> Any:
    """The same lists, mappings and texts, with surrogates as `\\udcff`."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8")
    if isinstance(value, dict):
        return {encodable(key): encodable(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(encodable, value))
    return value
