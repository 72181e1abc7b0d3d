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

COMMON = ("--headless", "--no-first-run", "--proxy-server=127.0.0.1:9")  # where no proxy is
GRAPHICS = ("--enable-unsafe-swiftshader",)  # the card that there is; where there is none, the processor
SIZE = (1200, 800)  # of the window, px
PATIENCE_S = 60


class BrowserTab:
    """A page in a browser of its own, which ends with it.

    program: the browser. folder: an empty one, for its profile. options: for its graphics. Raises RunError where it
    does not answer, and for errors in the page.
    """

    def __init__(self, program: str, folder: Path, options: Sequence[str] = GRAPHICS) -> None:
        profile = folder / "profile"
        call = [program, *COMMON, *(["--no-sandbox"] if os.geteuid() == 0 else [])]  # which root can't have
        call += [f"--user-data-dir={profile}", f"--window-size={SIZE[0]},{SIZE[1]}", *options]
        call += ["--remote-debugging-port=0", "--remote-allow-origins=*", "about:blank"]
        self._number, self._session, self._socket = 0, None, None
        self._process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            port, path = wait_for(functools.partial(_lines, profile / "DevToolsActivePort"))
            self._socket = websocket.create_connection(f"ws://127.0.0.1:{port}{path}", timeout=PATIENCE_S)
            (target,) = [one for one in self.call("Target.getTargets")["targetInfos"] if one["type"] == "page"]
            attached = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
            self._session = attached["sessionId"]
            self.start()
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Switch on what is asked of the browser."""
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
        self._number += 1
        session = {"sessionId": self._session} if self._session else {}
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params, **session}))
        while True:
            message = json.loads(self._socket.recv())
            self.notice(message)
            if message.get("id") == self._number:
                if "error" in message:
                    raise RunError(f"the browser refuses {method}: {message['error'].get('message')}")
                return message["result"]

    def notice(self, message: dict[str, Any]) -> None:
        """Take note of a message of the browser's."""

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page, or of the Promise that it is."""
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
    """Return what a function returns as soon as that is true; raises RunError where it takes too long."""
    end = time.monotonic() + PATIENCE_S
    while not (answer := ask()):
        if time.monotonic() > end:
            raise RunError(f"the browser or its page is not ready after {PATIENCE_S} s")
        time.sleep(0.02)
    return answer


def _lines(file: Path) -> list[str]:
    text = file.read_text() if file.is_file() else ""
    return text.split("\n")[:2] if "\n" in text else []
