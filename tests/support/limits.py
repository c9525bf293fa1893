"""How long reading a small file may take, how much memory, and how many broken ones are tried."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "2"))
"""Broken inputs of a kind."""
SECONDS = 60
"""Of a processor: the first file of a kind compiles what goes on with it."""
TIMEOUT = 600
"""Of the clock, in all tests: what takes longer hangs, however busy the machine is."""
PAGE_TIMEOUT = 40
"""Of the clock, for what a page in the browser is waited for."""
MEMORY = 1 << 30
"""Bytes that reading a small file may take at most."""


class OverrunError(BaseException):
    """It took too long: no Exception, which somebody on the way might take for an answer."""


@contextmanager
def limited(seconds: int = SECONDS, memory: int = MEMORY) -> Iterator[None]:
    """Fail where the block takes longer or more; memory is looked at on Linux alone."""

    def stop(number, frame):
        raise OverrunError(f"took over {seconds} s, or waited {TIMEOUT} s")

    before = [signal.signal(each, stop) for each in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, TIMEOUT)
    begin = resident()
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGPROF, before[0])
        signal.signal(signal.SIGALRM, before[1])
    taken = resident("VmHWM") - begin
    assert taken < memory, f"took {taken >> 20} MB"


def resident(which: str = "VmRSS") -> int:
    """Bytes of memory of this process; "VmHWM" is the most since "VmRSS" was asked for."""
    status = Path("/proc/self/status")
    if not status.exists():
        return 0
    if which == "VmRSS":
        Path("/proc/self/clear_refs").write_text("5")
    (line,) = [line for line in status.read_text().splitlines() if line.startswith(which)]
    return int(line.split()[1]) << 10
