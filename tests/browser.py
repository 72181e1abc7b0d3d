"""A real browser for tests, driven through the DevTools protocol: pages from disk, without a network."""

import base64
import functools
import json
import subprocess
import time

import pytest
import websocket

from replicate.poser.browser_pictures import BROWSERS, GRAPHICS, browser

COMMON = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--proxy-server=127.0.0.1:9")
SIZE = (1200, 800)
PATIENCE_S = 60


def command(profile, *options):
    """Return a browser's command line; a test without one is skipped. profile: an empty folder."""
    program = browser()
    if program is None:
        pytest.skip(f"needs a browser, one of {', '.join(BROWSERS)}")
    size = f"--window-size={SIZE[0]},{SIZE[1]}"
    return [program, *COMMON, f"--user-data-dir={profile}", size, *(options or GRAPHICS)]


class Tab:
    """A page in a browser of its own. requests: the addresses that it has asked for; errors: what went wrong in it."""

    def __init__(self, folder, *options):
        self.folder, self.requests, self.errors, self._number = folder, [], [], 0
        profile = folder / "profile"
        debugging = ["--remote-debugging-port=0", "--remote-allow-origins=*", "about:blank"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen([*command(profile, *options), *debugging], **quiet)
        try:
            port, path = wait_for(lambda: _lines(profile / "DevToolsActivePort"))
            self._socket = websocket.create_connection(f"ws://127.0.0.1:{port}{path}", timeout=PATIENCE_S)
            self._session = None
            (target,) = [t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page"]
            attached = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
            self._session = attached["sessionId"]
            for domain in ("Page", "Runtime", "Network", "DOM"):
                self.call(f"{domain}.enable")
            self.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def close(self):
        """End the browser."""
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def call(self, method, **params):
        """Return the answer to a command of the protocol."""
        self._number += 1
        session = {"sessionId": self._session} if self._session else {}
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params, **session}))
        while True:
            message = json.loads(self._socket.recv())
            self._note(message)
            if message.get("id") == self._number:
                assert "error" not in message, f"{method}: {message['error']}"
                return message["result"]

    def _note(self, message):
        facts = message.get("params", {})
        if message.get("method") == "Network.requestWillBeSent":
            self.requests.append(facts["request"]["url"])
        elif message.get("method") == "Runtime.exceptionThrown":
            self.errors.append(facts["exceptionDetails"])

    def evaluate(self, expression):
        """Return the value of an expression in the page, or of the Promise that it is."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def open(self, address, ready):
        """Open an address and wait until an expression is true there."""
        self.call("Page.navigate", url=address)
        self.wait(ready)

    def wait(self, expression):
        """Wait until an expression is true in the page."""
        return wait_for(functools.partial(self.evaluate, expression))

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


def wait_for(ask):
    """Return what a function returns as soon as that is true."""
    end = time.monotonic() + PATIENCE_S
    while not (answer := ask()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)
    return answer


def _lines(file):
    return file.read_text().split("\n")[:2] if file.is_file() and "\n" in file.read_text() else None
