"""A page in a real browser, driven through its DevTools protocol: opened from disk, without a network."""

import functools
import json
import os
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import websocket

from replicate.base.exceptions import RunError

COMMON = ("--headless", "--no-first-run", "--proxy-server=127.0.0.1:9")  # no proxy is there: no network
GRAPHICS = ("--enable-unsafe-swiftshader",)  # the processor draws where there is no graphics card
SIZE = (1200, 800)  # of the window, px
PATIENCE_S = 60


class BrowserTab:
    """A page in a new process of a browser, which ends with the tab.

    program: the browser. folder: an empty one, for the browser's profile. options: for its graphics. Raises RunError
    where the browser does not answer, and for errors in the page.
    """

    def __init__(self, program: str, folder: Path, options: Sequence[str] = GRAPHICS) -> None:
        profile = folder / "profile"
        call = [program, *COMMON, *(["--no-sandbox"] if os.geteuid() == 0 else [])]  # which root can't have
        call += [f"--user-data-dir={profile}", f"--window-size={SIZE[0]},{SIZE[1]}", *options]
        call += ["--remote-debugging-port=0", "--remote-allow-origins=*", "about:blank"]
        self._calls, self._session, self._socket = 0, None, None
        self._process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            port, path = wait_for(functools.partial(_lines, profile / "DevToolsActivePort"))
            self._socket = websocket.create_connection(f"ws://127.0.0.1:{port}{path}", timeout=PATIENCE_S)
            targets = self.call("Target.getTargets")["targetInfos"]
            (target,) = [target for target in targets if target["type"] == "page"]
            attached = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
            self._session = attached["sessionId"]
            self.start()
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Switch on the protocol's domains that the tab needs."""
        for domain in ("Page", "Runtime"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> "BrowserTab":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the browser, and the connection to it."""
        if self._socket is not None:
            self._socket.shutdown()
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def call(self, method: str, **params: object) -> dict[str, Any]:
        """Return the answer to a command of the protocol."""
        self._calls += 1
        session = {"sessionId": self._session} if self._session else {}
        self._socket.send(json.dumps({"id": self._calls, "method": method, "params": params, **session}))
        while True:
            message = json.loads(self._socket.recv())
            self.notice(message)
            if message.get("id") == self._calls:
                if "error" in message:
                    raise RunError(f"the browser refuses {method}: {message['error'].get('message')}")
                return message["result"]

    def notice(self, message: dict[str, Any]) -> None:
        """Look at a message from the browser; subclasses take notes."""

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page, awaited where it is a Promise."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if wrong := answer.get("exceptionDetails"):
            raise RunError(f"the page fails: {wrong.get('exception', {}).get('description') or wrong['text']}")
        return answer["result"].get("value")

    def open(self, address: str, ready: str) -> None:
        """Open an address and wait until a JavaScript expression is true there."""
        self.call("Page.navigate", url=address)
        self.wait(ready)

    def wait(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page as soon as it is true."""
        return wait_for(functools.partial(self.evaluate, expression))


def wait_for(ask: Callable[[], Any]) -> Any:
    """Call a function until it returns something true, and return that. Raises RunError where it takes too long."""
    end = time.monotonic() + PATIENCE_S
    while not (answer := ask()):
        if time.monotonic() > end:
            raise RunError(f"the browser or its page is not ready after {PATIENCE_S} s")
        time.sleep(0.02)
    return answer


def _lines(file: Path) -> list[str]:
    text = file.read_text() if file.is_file() else ""
    return text.split("\n")[:2] if "\n" in text else []
