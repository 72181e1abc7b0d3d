"""A browser that is driven: what is open to it is closed, however its page ends."""

import json
import subprocess
from types import SimpleNamespace

import pytest

from replicate.base.exceptions import RunError
from replicate.benchmarks import browser_tab


class Socket:
    """A connection to a browser with one page, or with one that refuses all commands."""

    def __init__(self, refuses: bool) -> None:
        self.refuses, self.number, self.is_open = refuses, 0, True

    def send(self, text: str) -> None:
        self.number = json.loads(text)["id"]

    def recv(self) -> str:
        page = {"targetInfos": [{"type": "page", "targetId": "a"}], "sessionId": "b"}
        return json.dumps({"id": self.number, **({"error": {"message": "no"}} if self.refuses else {"result": page})})

    def shutdown(self) -> None:
        self.is_open = False


@pytest.fixture
def connect(monkeypatch, tmp_path):
    """Return the function that opens a tab over a connection, without a browser."""
    process = SimpleNamespace(terminate=lambda: None, wait=lambda seconds: 0)
    monkeypatch.setattr(subprocess, "Popen", lambda call, **streams: process)
    monkeypatch.setattr(browser_tab, "wait_for", lambda ask: ("1", "/"))

    def tab(socket: Socket) -> browser_tab.BrowserTab:
        monkeypatch.setattr(browser_tab.websocket, "create_connection", lambda address, timeout: socket)
        return browser_tab.BrowserTab("browser", tmp_path)

    return tab


def test_the_connection_ends_with_the_tab(connect):
    socket = Socket(refuses=False)
    with connect(socket):
        assert socket.is_open
    assert not socket.is_open


def test_the_connection_ends_where_the_page_does_not_answer(connect):
    socket = Socket(refuses=True)
    with pytest.raises(RunError, match=r"the browser refuses Target\.getTargets: no"):
        connect(socket)
    assert not socket.is_open


def test_a_browser_that_never_answers_leaves_no_connection_to_end(connect, monkeypatch):
    def refuse(ask):
        raise RunError("the browser or its page is not ready")

    monkeypatch.setattr(browser_tab, "wait_for", refuse)
    with pytest.raises(RunError, match="not ready"):
        connect(Socket(refuses=False))
