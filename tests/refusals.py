"""What becomes of bad input."""

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
