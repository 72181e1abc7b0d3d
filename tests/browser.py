"""A real browser for tests, driven through the DevTools protocol: pages from disk, without a network."""

import base64
import functools
import json

import pytest

from replicate.benchmarks.browser_tab import COMMON, SIZE, BrowserTab, wait_for
from replicate.poser.browser_pictures import BROWSERS, GRAPHICS, browser


def command(profile, *options):
    """Return a browser's command line; a test without one is skipped. profile: an empty folder."""
    size = f"--window-size={SIZE[0]},{SIZE[1]}"
    return [
        program(),
        *COMMON,
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={profile}",
        size,
        *(options or GRAPHICS),
    ]


def program():
    """Return this machine's browser; a test without one is skipped."""
    return browser() or pytest.skip(f"needs a browser, one of {', '.join(BROWSERS)}")


class Tab(BrowserTab):
    """A page in a browser of its own. requests: the addresses that it has asked for; errors: what went wrong in it."""

    def __init__(self, folder, *options):
        self.folder, self.requests, self.errors = folder, [], []
        super().__init__(program(), folder, ("--disable-gpu", *(options or GRAPHICS)))

    def start(self):
        """Switch on what tests ask of the browser."""
        super().start()
        for domain in ("Network", "DOM"):
            self.call(f"{domain}.enable")
        self.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(self.folder))

    def notice(self, message):
        """Take note of what the page has asked for, and of what went wrong in it."""
        facts = message.get("params", {})
        if message.get("method") == "Network.requestWillBeSent":
            self.requests.append(facts["request"]["url"])
        elif message.get("method") == "Runtime.exceptionThrown":
            self.errors.append(facts["exceptionDetails"])

    def place(self, selector):
        """Return the middle of an element in the window, px."""
        box = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
        return self.evaluate(f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2])({box})")

    def mouse(self, kind, x, y, **more):
        """Send what a mouse does: "Pressed", "Moved" or "Released"."""
        held = (
            {"button": "left", "buttons": 1, "clickCount": 1} if kind != "Moved" else {"button": "left", "buttons": 1}
        )
        self.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **(held | more))

    def pull(self, start, end, steps=4):
        """Press the mouse at a place, move it to another one, and release it."""
        self.mouse("Moved", *start, buttons=0)
        self.mouse("Pressed", *start)
        for k in range(1, steps + 1):
            self.mouse("Moved", *(a + (b - a) * k / steps for a, b in zip(start, end, strict=True)))
        self.mouse("Released", *end)

    def swipe(self, start, end, steps=4):
        """Put a finger down at a place, move it to another one, and lift it."""
        touch = functools.partial(self.call, "Input.dispatchTouchEvent")
        touch(type="touchStart", touchPoints=[{"x": start[0], "y": start[1]}])
        for k in range(1, steps + 1):
            x, y = (a + (b - a) * k / steps for a, b in zip(start, end, strict=True))
            touch(type="touchMove", touchPoints=[{"x": x, "y": y}])
        touch(type="touchEnd", touchPoints=[])

    def click(self, selector):
        """Click an element with the mouse."""
        self.pull(place := self.place(selector), place, 1)

    def choose_file(self, selector, file):
        """Choose a file in an input element, as its dialog would."""
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", files=[str(file)], nodeId=node)

    def downloaded(self, name):
        """Return a file that the page has saved, once it is whole."""
        file = self.folder / name
        return wait_for(lambda: file if file.is_file() and file.stat().st_size else None)

    def picture(self):
        """Return the window as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot")["data"])
