"""`saccade serve`: a local page that shows what is found in a photograph."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from socket import socket

SHUTDOWN_TIMEOUT = 2
"""Seconds that an answer on its way has when the server is ended."""


def serve(
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of this machine; 0 takes a free one.")
    ] = 8014,
    max_upload: Annotated[
        float, typer.Option(min=0.1, max=1000, help="Megabytes that a photograph may have.")
    ] = 32.0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Drop a photograph on a page: attention, scanpath and interest points, with sliders.

    The page is for this machine only (127.0.0.1); nothing is stored. Every
    setting has its preset, and what was set can be copied as Python or as a
    command. Ctrl-C ends it.
    """
    from contextlib import suppress
    from importlib.resources import files

    from saccade.cli.output import print_message
    from saccade.extras import import_optional
    from saccade.serving.analysis import PhotoAnalyzer
    from saccade.serving.controls import controls

    uvicorn = import_optional("uvicorn", "serve")
    import_optional("starlette", "serve")
    from saccade.serving.app import Samples, application

    data = files("saccade") / "data"
    names = sorted(each.name for each in data.iterdir() if each.name.endswith(".jpg"))
    samples = Samples(tuple(names), lambda name: (data / name).read_bytes())
    with _listening(port) as listener:
        port = listener.getsockname()[1]
        app = application(PhotoAnalyzer(), samples, port, int(max_upload * 1e6), controls())
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, timeout_graceful_shutdown=SHUTDOWN_TIMEOUT
        )
        print_message(f"open http://127.0.0.1:{port}/ in a browser; Ctrl-C ends it")
        if browser:
            _open_browser(f"http://127.0.0.1:{port}/")
        with suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listener])
    print_message("ended")


def _listening(port: int) -> "socket":
    """A socket of this machine, to which no other machine has access."""
    import socket

    from saccade.errors import ConfigError
    from saccade.files import reason_of

    try:
        return socket.create_server(("127.0.0.1", port), backlog=64)
    except OSError as error:
        raise ConfigError(
            f"port: {port} cannot be used: {reason_of(error)}; try --port 0"
        ) from error


def _open_browser(address: str) -> None:
    """Open a page, where somebody sits before a screen."""
    import sys
    import webbrowser
    from threading import Thread

    if sys.stderr is not None and sys.stderr.isatty():
        Thread(target=webbrowser.open, args=(address,), daemon=True).start()
