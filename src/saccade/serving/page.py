"""The page of `saccade serve` and its Content-Security-Policy."""

from collections.abc import Mapping
from typing import Any

from saccade.viewing.embedding import json_element
from saccade.viewing.page import html_document, security_policy, web_file

VIEWING_SCRIPTS = ("report.js", "photo.js", "image.js")
SCRIPTS = ("controls.js", "serve.js")
PACKAGE = "saccade.serving"
TITLE = "saccade"
LEAD = (
    "Where a photograph draws the eye, and what in it can be found again. "
    "It stays on this machine, and is not stored."
)


def serve_page(data: Mapping[str, Any]) -> tuple[str, str]:
    """The page as the text of one HTML file, and its Content-Security-Policy.

    Args:
        data: the input of its script.
    """
    styles = [web_file("page.css"), web_file("report.css"), web_file("serve.css", PACKAGE)]
    scripts = [web_file(name) for name in VIEWING_SCRIPTS]
    scripts += [web_file(name, PACKAGE) for name in SCRIPTS]
    body = f'<div id="serve">{json_element(data)}</div>\n'
    body += "<noscript><p>This page needs JavaScript.</p></noscript>"
    icon = '<link rel="icon" href="data:,">\n'
    page = html_document(TITLE, LEAD, body, styles, scripts, icon)
    sources = ("img-src 'self' data:", "connect-src 'self'", "frame-ancestors 'none'")
    return page, security_policy(styles, scripts, *sources)
