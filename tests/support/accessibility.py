"""Whether a page can be read by everybody."""

import pytest


def assert_accessible(page):
    """That axe finds nothing and nothing is cut off, on a dark telephone and a light screen."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe")
    for scheme, width in (("dark", 390), ("light", 1280)):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": 800})
        found = axe.Axe().run(page)
        assert found.violations_count == 0, found.generate_report()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
