"""Pages that hold everything they show."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import cv2
import numpy as np

from coin3d.report.html import figure, page, paragraph, table

VOID = {"meta", "img", "br"}


class Balance(HTMLParser):
    """Fails on tags that are not closed in order; collects the addresses a page would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def fetched(content: str) -> list[str]:
    """Addresses of everything outside the page, after checking that the page is well formed."""
    parser = Balance()
    parser.feed(content)
    assert parser.open == []
    return [a for a in parser.addresses if not a.startswith(("data:", "#"))] + re.findall(r"url\(|@import|<script", content)


def test_a_page_fetches_nothing_and_is_balanced() -> None:
    content = page("a <b>", [paragraph("1 < 2 & 3"), table(["x"], [[0.5]]), figure(np.zeros((4, 6, 3), np.uint8), 'say "hi"')])
    assert fetched(content) == []
    assert "a &lt;b&gt;" in content and "1 &lt; 2 &amp; 3" in content and "<b>" not in content


def test_numbers_keep_three_digits_and_words_stand_left() -> None:
    content = table(["who", "mAP", "boxes"], [["direct", 0.12345, 7]])
    assert '<td class="words short">direct</td><td>0.123</td><td>7</td>' in content  # short ones are not broken
    assert '<td class="words">one that is long enough to be broken</td>' in table(
        ["a"], [["one that is long enough to be broken"]]
    )
    assert content.count("<th class=words>") == 1


def test_figures_hold_the_picture() -> None:
    image = np.zeros((20, 30, 3), np.uint8)
    image[..., 0] = 200
    encoded = re.search(r"base64,([^\"]+)", figure(image, "red"))
    assert encoded is not None
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(encoded[1]), np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape == (20, 30, 3)
    np.testing.assert_allclose(decoded[10, 15], (0, 0, 200), atol=6)  # BGR
