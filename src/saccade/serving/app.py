"""The local server: receives photographs, analyzes them one at a time, stores nothing on disk."""

import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from threading import Event, Thread
from typing import Any, NamedTuple, NoReturn

import anyio
from anyio.to_thread import run_sync
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route

from saccade.errors import SaccadeError
from saccade.serving.analysis import PhotoAnalyzer
from saccade.serving.guard import Guard, TooLargeError, read_body
from saccade.serving.page import serve_page
from saccade.viewing.embedding import as_json

MAX_REQUEST_BYTES = 100_000
"""Of a request other than a photograph."""
MAX_WAITING = 16
"""Requests that wait while one is processed; more are rejected."""
CLIENT_CLOSED_REQUEST = 499
"""Status of a response whose client has disconnected."""

_logger = logging.getLogger(__name__)


class Samples(NamedTuple):
    """Example photographs."""

    names: tuple[str, ...]
    """Of JPEG files."""
    read: Callable[[str], bytes]


class Server:
    """State shared by the routes; requests are processed one at a time, in order of arrival.

    Args:
        analyzer: analyzes the photographs.
        samples: example photographs.
        max_bytes: of a photograph.
    """

    def __init__(self, analyzer: PhotoAnalyzer, samples: Samples, max_bytes: int) -> None:
        self._analyzer = analyzer
        self._samples = samples
        self._max_bytes = max_bytes
        self._limiter = anyio.CapacityLimiter(1)
        self._waiting = 0
        self._warmed_up = Event()

    def warm_up(self) -> None:
        """Compile in the background while the page is served already."""

        def work() -> None:
            try:
                self._analyzer.warm_up()
            finally:
                self._warmed_up.set()

        Thread(target=work, name="saccade-warm-up", daemon=True).start()

    async def state(self, _: Request) -> Response:
        """Whether everything is compiled."""
        return _json_response({"warm": self._warmed_up.is_set()})

    async def sample(self, request: Request) -> Response:
        """An example photograph."""
        name = request.path_params["name"]
        if name not in self._samples.names:
            raise HTTPException(404, "no such photograph")
        return Response(await run_sync(self._samples.read, name), media_type="image/jpeg")

    async def open(self, request: Request) -> Response:
        """Opens a photograph, the body of the request."""
        data = await _body(request, self._max_bytes)
        name = request.query_params.get("name", "photograph")
        return await self._process(request, lambda: self._analyzer.open(data, name))

    async def analyze(self, request: Request) -> Response:
        """Saliency and scanpath, by the settings in the body."""
        settings = await _json_body(request)
        return await self._process(request, lambda: self._analyzer.analyze(settings))

    async def detect(self, request: Request) -> Response:
        """Interest points, by the settings in the body."""
        settings = await _json_body(request)
        return await self._process(request, lambda: self._analyzer.detect(settings))

    async def _process(self, request: Request, work: Callable[[], Mapping[str, Any]]) -> Response:
        """The result of `work`, which is skipped if the client has disconnected by then."""
        if self._waiting >= MAX_WAITING:
            raise HTTPException(503, "busy: too many requests wait already")
        self._waiting += 1
        try:
            async with self._limiter:
                if await request.is_disconnected():
                    return Response(status_code=CLIENT_CLOSED_REQUEST)
                return _json_response(await run_sync(work))
        except KeyError as error:
            raise HTTPException(404, str(error.args[0])) from error
        except SaccadeError as error:
            raise HTTPException(422, str(error)) from error
        finally:
            self._waiting -= 1


def application(
    analyzer: PhotoAnalyzer,
    samples: Samples,
    port: int,
    max_bytes: int,
    controls: Mapping[str, Any],
) -> Starlette:
    """The server as an ASGI application.

    Args:
        analyzer: analyzes the photographs.
        samples: example photographs.
        port: of this server; requests to another host name are rejected.
        max_bytes: of a photograph.
        controls: the settings of the page and their controls.
    """
    server = Server(analyzer, samples, max_bytes)
    page, policy = serve_page({**controls, "max_bytes": max_bytes, "samples": samples.names})

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        server.warm_up()
        yield

    async def front_page(_: Request) -> Response:
        return HTMLResponse(page)

    return Starlette(
        routes=[
            Route("/", front_page),
            Route("/state", server.state),
            Route("/samples/{name}", server.sample),
            Route("/photo", server.open, methods=["POST"]),
            Route("/look", server.analyze, methods=["POST"]),
            Route("/points", server.detect, methods=["POST"]),
        ],
        middleware=[Middleware(Guard, port=port, policy=policy)],
        exception_handlers={HTTPException: _one_line, Exception: _internal_error},
        lifespan=lifespan,
    )


async def _body(request: Request, max_bytes: int) -> bytes:
    try:
        return await read_body(request, max_bytes)
    except TooLargeError as error:
        message = f"too large: expected at most {max_bytes / 1e6:g} MB"
        raise HTTPException(413, message, {"Connection": "close"}) from error
    except ClientDisconnect as error:
        raise HTTPException(CLIENT_CLOSED_REQUEST) from error


async def _json_body(request: Request) -> dict[str, Any]:
    body = await _body(request, MAX_REQUEST_BYTES)
    try:
        value = json.loads(body, parse_constant=_reject_constant)
    except (ValueError, RecursionError) as error:
        raise HTTPException(400, "expected JSON") from error
    if not isinstance(value, dict):
        raise HTTPException(400, "expected a JSON object")
    return value


def _json_response(data: Mapping[str, Any]) -> Response:
    return Response(as_json(data), media_type="application/json")


async def _one_line(_: Request, error: Exception) -> Response:
    status = getattr(error, "status_code", 500)
    message = getattr(error, "detail", "")
    return PlainTextResponse(f"{message}\n", status, getattr(error, "headers", None))


async def _internal_error(_: Request, error: Exception) -> Response:
    _logger.error("serve: %s: %s", type(error).__name__, error)
    return PlainTextResponse("something went wrong; the terminal says what\n", 500)


def _reject_constant(word: str) -> NoReturn:
    raise ValueError(word)
