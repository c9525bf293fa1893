"""Python in a process of its own."""

import subprocess
import sys

from support.limits import TIMEOUT


def run_python(*words, cwd=None, env=None, prepare=None, timeout=TIMEOUT, check=False, stdin=None):
    """Run the interpreter with these words; what it prints is kept as text.

    `prepare` is called in the child before it, and `stdin` is the text that it reads.
    """
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        env=env,
        preexec_fn=prepare,
        input=stdin,
        capture_output=True,
        text=True,
        check=check,
        timeout=timeout,
    )
