"""Parts of an HTML page that holds everything it shows: no scripts, no fonts, no files beside it."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

_JPEG_QUALITY = 86

_SHORT = 24
"""Characters of a cell that are kept on one line: names and numbers with their units."""

_STYLE = """
:root { color-scheme: light dark; --ink: #1d2129; --soft: #5b6472; --line: #d9dee6; --paper: #fff; --shade: #f4f6f9; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e9ee; --soft: #9aa4b2; --line: #343b46; --paper: #16191e; --shade: #1e2229; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1500px; padding: 2rem 1.5rem 4rem; background: var(--paper); color: var(--ink);
       font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; } h2 { margin: 2.6rem 0 .6rem; font-size: 1.35rem; } h3 { margin: 1.6rem 0 .4rem; }
p { max-width: 52rem; } .lead { font-size: 1.1rem; color: var(--soft); }
.note { border-left: 4px solid #d98e04; background: var(--shade); padding: .7rem 1rem; max-width: 56rem; }
table { border-collapse: collapse; margin: .8rem 0; } .wide { overflow-x: auto; }
th, td { padding: .4rem .6rem; border-bottom: 1px solid var(--line); text-align: right; font-variant-numeric: tabular-nums; }
th { color: var(--soft); font-weight: 600; } th.words, td.words { text-align: left; } td.short { white-space: nowrap; }
figure { margin: 1rem 0 1.6rem; } figure img { width: 100%; height: auto; border-radius: 6px; display: block; }
figcaption { color: var(--soft); font-size: .92rem; margin-top: .35rem; }
.pair { display: grid; grid-template-columns: minmax(0, 2.2fr) minmax(0, 1fr); gap: .8rem; align-items: start; }
@media (max-width: 800px) { .pair { grid-template-columns: 1fr; } }
.pair figure { margin: 0 0 .8rem; }
pre { background: var(--shade); padding: .8rem 1rem; overflow-x: auto; border-radius: 6px;
      font-size: .82rem; line-height: 1.4; }
details summary { cursor: pointer; color: var(--soft); }
.swatch { display: inline-block; width: .8em; height: .8em; border-radius: 2px; vertical-align: -0.05em; margin-right: .3em; }
"""


def page(title: str, body: Sequence[str]) -> str:
    """The whole file."""
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{text(title)}</title>'
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}<style>{_STYLE}</style></head>\n<body>\n'
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def text(words: str) -> str:
    """Words with the characters that mean something in HTML escaped."""
    return html.escape(words)


def paragraph(words: str, kind: str = "") -> str:
    """A paragraph of plain words."""
    return f'<p class="{kind}">{text(words)}</p>' if kind else f"<p>{text(words)}</p>"


def table(header: Sequence[str], rows: Sequence[Sequence[str | float | int]]) -> str:
    """A table; fractions with three digits."""
    words = {i for row in rows for i, cell in enumerate(row) if isinstance(cell, str)}
    head = "".join(f"<th{' class=words' if i in words else ''}>{text(cell)}</th>" for i, cell in enumerate(header))
    body = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>'


def _cell(value: str | float | int) -> str:
    if isinstance(value, str):
        kind = "words short" if len(value) <= _SHORT else "words"
        return f'<td class="{kind}">{text(value)}</td>'
    return f"<td>{value:.3f}</td>" if isinstance(value, float) else f"<td>{value}</td>"


def figure(image: UInt8[np.ndarray, "h w 3"], caption: str) -> str:
    """A picture inside the page, as JPEG."""
    encoded, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not encoded:
        raise ValueError(f"a picture of shape {image.shape} cannot be encoded as JPEG ({caption})")
    source = "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
    caption_text = text(caption)
    return f'<figure><img src="{source}" alt="{caption_text}"><figcaption>{caption_text}</figcaption></figure>'
