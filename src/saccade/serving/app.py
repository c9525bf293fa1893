"""The local server: receives photographs, processes requests one by one, stores nothing on disk.

A server on the loopback interface can be reached by every page that its user has open: by a
cross-origin request, which has another Origin, or by DNS rebinding, with another Host. Both are
rejected.
"""

import json
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from threading import Event, Thread
from typing import Any, NoReturn

import anyio
from anyio.to_thread import run_sync
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from saccade.errors import SaccadeError
from saccade.serving.analysis import PhotoAnalyzer
from saccade.serving.playground import Playground
from saccade.viewing.page import as_json, html_document, json_element, security_policy, web_file

WARM_UP = "saccade-warm-up"
"""Name of the thread that compiles everything."""
MAX_REQUEST_BYTES = 100_000
"""Size of a request other than a photograph."""
MAX_WAITING = 16
"""Requests that wait while one is processed; more are rejected."""
CLIENT_CLOSED_REQUEST = 499
"""Status of a response whose client has disconnected."""
HOST_NAMES = ("127.0.0.1", "localhost", "[::1]")
"""Names of this machine, as a browser on it writes them."""
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response: no other page frames, reads or keeps it."""
LEAD = (
    "Saliency, scanpath and interest points of a photograph, and EKF-SLAM to try out. "
    "All stays on this machine, and nothing is stored."
)

_logger = logging.getLogger(__name__)


def application(
    analyzer: PhotoAnalyzer,
    playground: Playground,
    samples: Mapping[str, bytes],
    port: int,
    max_bytes: int,
    controls: Mapping[str, Any],
) -> Starlette:
    """The server as an ASGI application.

    Args:
        analyzer: analyzes the photographs.
        playground: takes the steps of SLAM.
        samples: example photographs: JPEG files by name.
        port: of this server; requests to another host name are rejected.
        max_bytes: of a photograph.
        controls: the settings of the page and their controls.
    """
    server = _Server(analyzer, playground, samples, max_bytes)
    work = {
        "look": analyzer.analyze,
        "points": analyzer.detect,
        "features": analyzer.features,
        "slam/start": playground.start,
        "slam/step": playground.step,
    }
    page, policy = serve_page({**controls, "max_bytes": max_bytes, "samples": list(samples)})

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        Thread(target=server.warm_up, name=WARM_UP, daemon=True).start()
        yield

    async def front_page(_: Request) -> Response:
        return HTMLResponse(page)

    return Starlette(
        routes=[
            Route("/", front_page),
            Route("/state", server.state),
            Route("/samples/{name}", server.sample),
            Route("/photo", server.open, methods=["POST"]),
            *(Route(f"/{path}", server.answer(do), methods=["POST"]) for path, do in work.items()),
        ],
        middleware=[Middleware(_Guard, port=port, policy=policy)],
        exception_handlers={HTTPException: _one_line, Exception: _internal_error},
        lifespan=lifespan,
    )


def serve_page(data: Mapping[str, Any]) -> tuple[str, str]:
    """The page as the text of one HTML file, and its Content-Security-Policy.

    Args:
        data: the input of its script.
    """
    package = "saccade.serving"
    styles = [web_file("page.css"), web_file("report.css"), web_file("serve.css", package)]
    shared = ("report.js", "photo.js", "image.js", "charts.js", "ground.js")
    scripts = [web_file(name) for name in shared]
    own = ("controls.js", "features.js", "playground_view.js", "playground.js", "serve.js")
    scripts += [web_file(name, package) for name in own]
    body = f'<div id="serve">{json_element(data)}</div>\n'
    body += "<noscript><p>This page needs JavaScript.</p></noscript>"
    icon = '<link rel="icon" href="data:,">\n'
    page = html_document("saccade", LEAD, body, styles, scripts, icon)
    sources = ("img-src 'self' data:", "connect-src 'self'", "frame-ancestors 'none'")
    return page, security_policy(styles, scripts, *sources)


class _Server:
    """The routes and their state; requests are processed one at a time, in order of arrival."""

    def __init__(
        self,
        analyzer: PhotoAnalyzer,
        playground: Playground,
        samples: Mapping[str, bytes],
        max_bytes: int,
    ) -> None:
        self._analyzer, self._playground = analyzer, playground
        self._samples, self._max_bytes = samples, max_bytes
        self._limiter = anyio.CapacityLimiter(1)
        self._waiting = 0
        self._warmed_up = Event()

    def warm_up(self) -> None:
        """Compile what the analyses need."""
        try:
            self._analyzer.warm_up()
            self._playground.warm_up()
        finally:
            self._warmed_up.set()

    async def state(self, _: Request) -> Response:
        """Whether everything is compiled."""
        return _json_response({"warm": self._warmed_up.is_set()})

    async def sample(self, request: Request) -> Response:
        """An example photograph."""
        data = self._samples.get(request.path_params["name"])
        if data is None:
            raise HTTPException(404, "no such photograph")
        return Response(data, media_type="image/jpeg")

    async def open(self, request: Request) -> Response:
        """Opens a photograph, the body of the request."""
        data = await _body(request, self._max_bytes)
        name = request.query_params.get("name", "photograph")
        return await self._process(request, lambda: self._analyzer.open(data, name))

    def answer(
        self, work: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    ) -> Callable[[Request], Awaitable[Response]]:
        """The route that gives the table in the body to `work` and answers with its result."""

        async def answered(request: Request) -> Response:
            settings = await _json_body(request)
            return await self._process(request, lambda: work(settings))

        return answered

    async def _process(self, request: Request, work: Callable[[], Mapping[str, Any]]) -> Response:
        """The result of `work`, which is skipped if the client has disconnected by then."""
        if self._waiting >= MAX_WAITING:
            raise HTTPException(503, "busy: too many requests are waiting")
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


class _Guard:
    """Rejects requests that do not come from the page itself, with 403 and one line.

    Args:
        app: answers the others.
        port: of this server.
        policy: the Content-Security-Policy of every response.
    """

    def __init__(self, app: ASGIApp, port: int, policy: str) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in HOST_NAMES}
        if port == 80:
            self._hosts.update(HOST_NAMES)
        self._headers = {**SECURITY_HEADERS, "Content-Security-Policy": policy}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(self._headers)
            await send(message)

        reason = self._rejection(Headers(scope=scope), scope["method"])
        app = self._app if reason is None else PlainTextResponse(f"refused: {reason}\n", 403)
        await app(scope, receive, send_with_headers)

    def _rejection(self, headers: Mapping[str, str], method: str) -> str | None:
        """Why a request is rejected; None where it is not."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if host not in self._hosts:
            return "the Host header does not name this server"
        is_link = method == "GET" and headers.get("sec-fetch-mode") == "navigate"
        same_site = headers.get("sec-fetch-site", "none") in ("none", "same-origin")
        if (origin is None or origin.lower() == f"http://{host}") and (same_site or is_link):
            return None
        return "cross-origin request"


async def _body(request: Request, max_bytes: int) -> bytes:
    """The body of a request, whatever length it declares."""
    body = bytearray()
    try:
        async for chunk in request.stream():
            body += chunk
            if len(body) > max_bytes:
                message = f"too large: expected at most {max_bytes / 1e6:g} MB"
                raise HTTPException(413, message, {"Connection": "close"})
    except ClientDisconnect as error:
        raise HTTPException(CLIENT_CLOSED_REQUEST) from error
    return bytes(body)


async def _json_body(request: Request) -> dict[str, Any]:
    body = await _body(request, MAX_REQUEST_BYTES)
    try:
        value = json.loads(body, parse_constant=_reject_constant)
    except (ValueError, RecursionError) as error:
        raise HTTPException(400, "expected JSON") from error
    if not isinstance(value, dict):
        raise HTTPException(400, "expected a JSON object")
    return value


def _reject_constant(word: str) -> NoReturn:
    """NaN and Infinity are not JSON."""
    raise ValueError(word)


def _json_response(data: Mapping[str, Any]) -> Response:
    return Response(as_json(data), media_type="application/json")


async def _one_line(_: Request, error: Exception) -> Response:
    status = getattr(error, "status_code", 500)
    message = getattr(error, "detail", "")
    return PlainTextResponse(f"{message}\n", status, getattr(error, "headers", None))


async def _internal_error(request: Request, error: Exception) -> Response:
    where = f"{request.method} {request.url.path}"
    _logger.error("serve: %s: %s: %s", where, type(error).__name__, error)
    return PlainTextResponse("internal error; the terminal shows it\n", 500)
