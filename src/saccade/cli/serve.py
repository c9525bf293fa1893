"""`saccade serve`: a local page that analyzes photographs and drives a robot with SLAM."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from saccade.cli.options import Options
from saccade.errors import setting

if TYPE_CHECKING:
    from socket import socket

SHUTDOWN_TIMEOUT = 2
"""Seconds granted to requests in progress when the server stops."""


@dataclass(frozen=True, kw_only=True)
class ServeOptions(Options):
    """Options of `saccade serve`."""

    port: int = setting(8014, 0, 65535)
    """Port on this machine, up to 65535; 0 selects a free port."""
    max_upload: Annotated[float, Parameter(metavar="MB")] = setting(32.0, 0.1, 1000)
    """Maximum size of a photograph, .1 to 1000 MB."""
    no_browser: bool = False
    """Do not open the page in the browser."""


def serve(options: ServeOptions = ServeOptions()) -> None:
    """Serve an interactive page for photographs and for SLAM.

    Photographs: saliency, scanpath and keypoints, with a control for every
    setting; the settings can be copied as a command with its file. SLAM: a
    playground that compares EKF-SLAM filters on a simulated robot. The page is
    served to this machine only (127.0.0.1), and nothing is stored. Ctrl-C stops
    the server.

    Example: saccade serve --port 8014
    """
    import signal
    import sys
    import webbrowser
    from contextlib import suppress
    from importlib.resources import files

    from saccade.cli.output import print_message
    from saccade.extras import import_optional

    uvicorn = import_optional("uvicorn", "serve")
    import_optional("starlette", "serve")
    from saccade.serving.analysis import PhotoAnalyzer
    from saccade.serving.app import application
    from saccade.serving.controls import controls
    from saccade.serving.playground import Playground

    data = files("saccade") / "data"
    names = sorted(each.name for each in data.iterdir() if each.name.endswith(".jpg"))
    samples = {name: (data / name).read_bytes() for name in names}
    with _listening(options.port) as listener:
        port = listener.getsockname()[1]
        parts = PhotoAnalyzer(), Playground()
        app = application(*parts, samples, port, int(options.max_upload * 1e6), controls())
        config = uvicorn.Config(
            app,
            ws="none",
            log_level="error",
            access_log=False,
            timeout_graceful_shutdown=SHUTDOWN_TIMEOUT,
        )
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends like Ctrl-C
        print_message(f"open http://127.0.0.1:{port}/ in a browser; Ctrl-C stops the server")
        if not options.no_browser and sys.stderr.isatty():
            webbrowser.open(f"http://127.0.0.1:{port}/")
        with suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listener])
    print_message("stopped")
    _leave_computations()


def _leave_computations() -> None:
    """End the process if a thread still computes: OpenCV threads abort an exiting process."""
    import os
    import sys
    import threading

    if threading.active_count() > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _listening(port: int) -> "socket":
    """A socket that other machines cannot reach."""
    import socket

    from saccade.errors import ConfigError
    from saccade.io.files import one_line

    try:
        listener = socket.create_server(("127.0.0.1", port), backlog=64)
    except OSError as error:
        raise ConfigError(
            f"port: {port} cannot be used: {one_line(error)}; try --port 0"
        ) from error
    # Accepted connections inherit it; without it each answer waits for an acknowledgement.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener
