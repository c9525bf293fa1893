"""The server: it takes a photograph, hands it to what looks at it, and keeps nothing on disk."""

import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from threading import Event, Thread
from typing import Any, NamedTuple, NoReturn, Protocol

import anyio
from anyio.to_thread import run_sync
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route

from saccade.errors import SaccadeError
from saccade.serving.guard import Guard, TooLargeError, body_of
from saccade.serving.page import serve_page
from saccade.viewing.embedding import as_json

MAX_REQUEST = 100_000
"""Bytes of a request that is no photograph."""
MAX_WAITING = 16
"""Requests that may wait while one is worked on; who comes then is sent away."""
CLIENT_CLOSED_REQUEST = 499
"""Status of an answer to somebody who has left."""

_logger = logging.getLogger(__name__)


class Analyzer(Protocol):
    """What looks at photographs."""

    def open(self, data: bytes, name: str) -> Mapping[str, Any]:
        """Hold a photograph; raises `SaccadeError` where it is none."""

    def analyze(self, wishes: Mapping[str, Any]) -> Mapping[str, Any]:
        """Where it draws the eye."""

    def detect(self, wishes: Mapping[str, Any]) -> Mapping[str, Any]:
        """Its interest points."""

    def warm_up(self) -> None:
        """Do everything once, so that the first photograph does not wait for a compiler."""


class Samples(NamedTuple):
    """Photographs to begin with."""

    names: tuple[str, ...]
    """Of JPEG files."""
    read: Callable[[str], bytes]


class Server:
    """What the routes share: one thing is worked on at a time, in the order of arrival.

    Args:
        bench: what looks.
        samples: photographs to begin with.
        most: bytes of a photograph.
    """

    def __init__(self, analyzer: Analyzer, samples: Samples, max_bytes: int) -> None:
        self.analyzer = analyzer
        self.samples = samples
        self.most = max_bytes
        self._one = anyio.CapacityLimiter(1)
        self._waiting = 0
        self._warmed_up = Event()

    def warm_up(self) -> None:
        """Let the bench warm up while the page is served already."""

        def work() -> None:
            try:
                self.analyzer.warm_up()
            finally:
                self._warmed_up.set()

        Thread(target=work, name="saccade-warm", daemon=True).start()

    async def state(self, _: Request) -> Response:
        """Whether everything is compiled."""
        return _answer({"warm": self._warmed_up.is_set()})

    async def sample(self, request: Request) -> Response:
        """One of the photographs to begin with."""
        name = request.path_params["name"]
        if name not in self.samples.names:
            raise HTTPException(404, "no such photograph")
        return Response(await run_sync(self.samples.read, name), media_type="image/jpeg")

    async def open(self, request: Request) -> Response:
        """A photograph, as the body of the request."""
        data = await self._body(request, self.most)
        name = request.query_params.get("name", "photograph")
        return await self._worked(request, lambda: self.analyzer.open(data, name))

    async def look(self, request: Request) -> Response:
        """Attention, by the wishes in the body."""
        wishes = await self._wishes(request)
        return await self._worked(request, lambda: self.analyzer.analyze(wishes))

    async def find(self, request: Request) -> Response:
        """Interest points, likewise."""
        wishes = await self._wishes(request)
        return await self._worked(request, lambda: self.analyzer.detect(wishes))

    async def _worked(self, request: Request, work: Callable[[], Mapping[str, Any]]) -> Response:
        """The answer, when its turn comes, unless who asked has left meanwhile."""
        if self._waiting >= MAX_WAITING:
            raise HTTPException(503, "busy: too many requests wait already")
        self._waiting += 1
        try:
            async with self._one:
                if await request.is_disconnected():
                    return Response(status_code=CLIENT_CLOSED_REQUEST)
                found = await run_sync(work)
        except KeyError as error:
            raise HTTPException(404, str(error.args[0])) from error
        except SaccadeError as error:
            raise HTTPException(422, str(error)) from error
        finally:
            self._waiting -= 1
        return _answer(found)

    async def _body(self, request: Request, max_bytes: int) -> bytes:
        try:
            return await body_of(request, max_bytes)
        except TooLargeError as error:
            words = f"too large: expected at most {max_bytes / 1e6:g} MB"
            raise HTTPException(413, words, {"Connection": "close"}) from error
        except ClientDisconnect as error:
            raise HTTPException(CLIENT_CLOSED_REQUEST) from error

    async def _wishes(self, request: Request) -> dict[str, Any]:
        body = await self._body(request, MAX_REQUEST)
        try:
            wishes = json.loads(body, parse_constant=_no_number)
        except (ValueError, RecursionError) as error:
            raise HTTPException(400, "expected JSON") from error
        if not isinstance(wishes, dict):
            raise HTTPException(400, "expected a JSON object")
        return wishes


def application(
    analyzer: Analyzer, samples: Samples, port: int, max_bytes: int, controls: Mapping[str, Any]
) -> Starlette:
    """The server as an ASGI application.

    Args:
        analyzer: what looks at photographs.
        samples: photographs to begin with.
        port: on which it is reached; it answers to no other name.
        max_bytes: bytes of a photograph.
        controls: what the page offers to change, for its script.
    """
    server = Server(analyzer, samples, max_bytes)
    page, policy = serve_page({**controls, "most": max_bytes, "samples": samples.names})

    @asynccontextmanager
    async def life(_: Starlette) -> AsyncIterator[None]:
        server.warm_up()
        yield

    async def front(_: Request) -> Response:
        return HTMLResponse(page)

    return Starlette(
        routes=[
            Route("/", front),
            Route("/state", server.state),
            Route("/samples/{name}", server.sample),
            Route("/photo", server.open, methods=["POST"]),
            Route("/look", server.look, methods=["POST"]),
            Route("/points", server.find, methods=["POST"]),
        ],
        middleware=[Middleware(Guard, port=port, policy=policy)],
        exception_handlers={HTTPException: _in_one_line, Exception: _surprise},
        lifespan=life,
    )


def _answer(found: Mapping[str, Any]) -> Response:
    return Response(as_json(found), media_type="application/json")


async def _in_one_line(_: Request, error: Exception) -> Response:
    status = getattr(error, "status_code", 500)
    words = getattr(error, "detail", "")
    return PlainTextResponse(f"{words}\n", status, getattr(error, "headers", None))


async def _surprise(_: Request, error: Exception) -> Response:
    _logger.error("serve: %s: %s", type(error).__name__, error)
    return PlainTextResponse("something went wrong; the terminal says what\n", 500)


def _no_number(word: str) -> NoReturn:
    raise ValueError(word)
