"""What a test asks of every page: one file, its own scripts only, every place drawn."""

import json
from base64 import b64encode
from hashlib import sha256
from html.parser import HTMLParser
from itertools import pairwise

VOID = {"meta", "img", "br"}
HEADINGS = ("h1", "h2", "h3", "h4")
MOST = 6_000_000
"""Bytes of a page."""


class Page(HTMLParser):
    """Reads a page: text, plots, attributes; fails where it is not all that a page must be."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.size = len(html.encode("utf-8"))
        self.feed(html)
        self.close()
        assert not self.open
        check_self_contained(self)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag == "script":
            self.scripts.append((dict(attrs), ""))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts[-1] = (self.scripts[-1][0], self.scripts[-1][1] + data)
        else:
            self.text += data

    @property
    def words(self) -> str:
        return " ".join(self.text.split())

    @property
    def plots(self) -> dict[str, dict[str, object]]:
        """What each place of the page draws."""
        found = [text for attrs, text in self.scripts if attrs.get("id") == "plots"]
        return json.loads(found[0]) if found else {}

    def values(self, name: str) -> list[str]:
        return [value for key, value in self.attributes if key == name]


def check_self_contained(page: Page) -> None:
    """One file: nothing fetched, no script but its own, every place drawn, headings in order."""
    assert not {"link", "iframe", "object", "embed", "base", "form", "img"} & {*page.tags}
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert not page.values("style") + page.values("src")
    ids = page.values("id")
    assert len(ids) == len({*ids})
    assert {*page.values("href")} <= {f"#{name}" for name in ids}  # the contents, and nothing else
    own = [name for name in ids if name != "plots" and not name.startswith("part-")]
    assert own == list(page.plots)
    assert page.size < MOST
    levels = [HEADINGS.index(tag) for tag in page.tags if tag in HEADINGS]
    assert levels[0] == 0
    assert levels.count(0) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    check_scripts(page)


def check_scripts(page: Page) -> None:
    """The library once, and no script that the head of the page does not allow by its digest."""
    (policy,) = [v for v in page.values("content") if v.startswith("default-src")]
    assert policy.startswith("default-src 'none'; ")
    if not page.plots:
        assert not page.scripts
        return
    data, library, own = page.scripts
    assert data[0] == {"type": "application/json", "id": "plots"}
    assert library[1].lstrip().startswith("/**\n* plotly.js v3")
    for _, script in (library, own):
        digest = b64encode(sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert "unsafe" not in policy.partition("script-src")[2]


def titles(page: Page) -> list[str]:
    """Return what the drawn places say they are, without the panel."""
    return list(dict.fromkeys(v.partition(":")[0] for v in page.values("aria-label")))
