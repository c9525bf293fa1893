"""Further seeds and worlds of a test, which take long."""

import pytest


def nightly(*values):
    """Parameters of a test that `nox -s nightly` runs; those of several arguments are tuples."""
    return [
        pytest.param(*(each if isinstance(each, tuple) else (each,)), marks=pytest.mark.nightly)
        for each in values
    ]
