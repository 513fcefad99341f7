"""The page's head: what a browser may do with the page."""

import base64
import hashlib
import re

from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def test_policy() -> None:
    """Nothing is loaded, sent or run, and the one style sheet is named by its hash."""
    page = render_html(analysis_of(c60_table(60, 4), c60_spec(60)))
    [policy] = re.findall(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', page)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert not {"script-src", "connect-src", "frame-src", "object-src"} & set(rules)
    assert rules["img-src"] == "data:"
    [style] = re.findall(r"<style>(.*?)</style>", page, re.S)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    assert rules["style-src-elem"] == f"'sha256-{digest}'"
    assert page.index("Content-Security-Policy") < page.index("<title>")
