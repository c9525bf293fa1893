"""What becomes of bad input."""

import re

import pytest

from saccade.errors import SaccadeError


def result_or_refusal(work):
    """What `work()` returns and "", or None and the one line in which it refuses."""
    try:
        return work(), ""
    except SaccadeError as error:
        message = str(error)
    assert message
    assert "\n" not in message
    return None, message


def refuses(kind, *parts):
    """A context in which an error of a kind is raised whose one line has some parts."""
    words = ".*".join(map(re.escape, parts))
    return pytest.raises(kind, match=f"^[^\\n]*{words}[^\\n]*$")
