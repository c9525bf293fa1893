"""The page that is served; its policy allows what it holds, and to ask the server that it is of."""

from collections.abc import Mapping
from typing import Any

from saccade.viewing.page import web_file, whole_page
from saccade.viewing.report import hashes, script_data

STYLES = ("page.css", "report.css", "serve.css")
SCRIPTS = ("report.js", "photo.js", "image.js", "controls.js", "serve.js")
TITLE = "saccade"
LEAD = (
    "Where a photograph draws the eye, and what in it can be found again. "
    "It stays on this machine, and is not stored."
)


def serve_page(data: Mapping[str, Any]) -> str:
    """The page as the text of one HTML file.

    Args:
        data: what its script is given.
    """
    head = '<meta name="color-scheme" content="light dark">\n'
    head += '<link rel="icon" href="data:,">\n'
    head += "\n".join(f"<style>{web_file(name)}</style>" for name in STYLES)
    body = f'<div id="serve"><script type="application/json">{script_data(data)}</script></div>\n'
    body += "<noscript><p>This page needs JavaScript.</p></noscript>\n"
    body += "\n".join(f"<script>{web_file(name)}</script>" for name in SCRIPTS)
    return whole_page(TITLE, LEAD, body, head)


def policy_of() -> str:
    """The Content-Security-Policy of that page."""
    return (
        "default-src 'none'; img-src 'self' data:; connect-src 'self'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'; "
        f"style-src {hashes([web_file(name) for name in STYLES])}; "
        f"script-src {hashes([web_file(name) for name in SCRIPTS])}"
    )
