"""A browser without a window, driven through pipes: what it draws, asks for and complains of."""

import json
import os
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 120  # s
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    "--remote-debugging-pipe",
)
HAND_OVER = """
import os, sys
reads, writes = int(sys.argv[1]), int(sys.argv[2])
os.dup2(reads, 60), os.dup2(writes, 61)
os.dup2(60, 3), os.dup2(61, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
SEEN = """(() => {
  const places = [...document.querySelectorAll(".plot")];
  return {
    places: places.length,
    drawn: places.filter((p) => p.querySelector(".main-svg")).length,
    overflow: document.documentElement.scrollWidth - window.innerWidth,
    wide: places.filter((p) => p.querySelector(".main-svg") &&
      p.querySelector(".main-svg").clientWidth > p.clientWidth + 1).length,
    ink: getComputedStyle(document.querySelector(".xtitle") || document.body).fill,
    text: document.body.innerText,
  };
})()"""


def found() -> str:
    """Return the browser there is; without one the test is skipped, and says so."""
    for name in NAMES:
        if path := shutil.which(name):
            return path
    pytest.skip(f"no browser to look with: none of {', '.join(NAMES)}")


class Browser:
    """One page of a browser, by its debugging protocol over file descriptors 3 and 4."""

    def __init__(self, path: str, folder: Path) -> None:
        here, theirs = os.pipe(), os.pipe()
        command = [path, *OPTIONS, f"--user-data-dir={folder}", "about:blank"]
        self.process = subprocess.Popen(
            [sys.executable, "-c", HAND_OVER, str(here[0]), str(theirs[1]), *command],
            pass_fds=(here[0], theirs[1]),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(here[0])
        os.close(theirs[1])
        self.ends = (here[1], theirs[0])
        self.number, self.rest, self.session = 0, b"", ""
        self.events: list[dict[str, Any]] = []

    def start(self) -> None:
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.number += 1
        message: dict[str, Any] = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.ends[0], json.dumps(message).encode() + b"\0")
        while True:
            answer = self.hear()
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def hear(self) -> dict[str, Any]:
        while b"\0" not in self.rest:
            assert select.select([self.ends[1]], [], [], PATIENCE)[0], "the browser is silent"
            part = os.read(self.ends[1], 1 << 20)
            assert part, "the browser is gone"
            self.rest += part
        message, _, self.rest = self.rest.partition(b"\0")
        return json.loads(message)

    def show(self, page: Path, width: int, scheme: str) -> dict[str, Any]:
        """Open a page, and return what is to be seen of it once all is drawn."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.ask("Emulation.setDeviceMetricsOverride", **size)
        colours = [{"name": "prefers-color-scheme", "value": scheme}]
        self.ask("Emulation.setEmulatedMedia", features=colours)
        self.events.clear()
        self.ask("Page.navigate", url=page.as_uri())
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self.hear())
        for _ in range(PATIENCE):
            seen = self.seen()
            if seen["drawn"] == seen["places"]:
                return seen
            self.run("new Promise((done) => setTimeout(done, 1000))")
        return seen

    def seen(self) -> dict[str, Any]:
        return self.run(SEEN)

    def run(self, expression: str) -> Any:
        answer = self.ask(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        return answer["result"].get("value")

    def complaints(self) -> list[str]:
        """Return errors, messages on the console, and requests for anything but the page."""
        bad = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
        told = [json.dumps(e["params"])[:300] for e in self.events if e.get("method") in bad]
        asked = [
            e["params"]["request"]["url"]
            for e in self.events
            if e.get("method") == "Network.requestWillBeSent"
        ]
        return [*told, *(url[:100] for url in asked[1:] if not url.startswith("data:"))]


@contextmanager
def browser(folder: Path) -> Iterator[Browser]:
    one = Browser(found(), folder)
    try:
        one.start()
        yield one
    finally:
        one.process.terminate()
        one.process.wait(20)
        for end in one.ends:
            os.close(end)
