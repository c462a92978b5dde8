"""A page in a real browser without a screen, driven as a person would: by what is on it."""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

from support.browser import BROWSER
from support.waiting import until

LIMIT_S = 40.0


class Page:
    """An open page, over the DevTools protocol."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._numbers = itertools.count(1)

    async def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page."""
        call = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        result = await self.call("Runtime.evaluate", **call)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a command of the protocol."""
        number = next(self._numbers)
        await self._connection.send(
            json.dumps({"id": number, "method": method, "params": parameters})
        )
        async for text in self._connection:
            answer = json.loads(text)
            if answer.get("id") == number:
                result: dict[str, Any] = answer["result"]
                return result
        raise AssertionError("the browser ended")

    async def becomes(self, expression: str, what: str = "") -> None:
        """Wait until an expression is true."""
        end = asyncio.get_running_loop().time() + LIMIT_S
        while not await self.evaluate(f"Boolean({expression})"):
            assert asyncio.get_running_loop().time() < end, what or expression
            await asyncio.sleep(0.05)


@asynccontextmanager
async def opened(url: str, profile: Path) -> AsyncIterator[Page]:
    """A page in a browser of its own; ``profile`` is an empty directory for that."""
    assert BROWSER is not None
    browser = await asyncio.create_subprocess_exec(
        BROWSER,
        "--headless=new",
        # The page is ours, and neither root nor a container can have the sandbox.
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--disable-background-networking",
        "--no-first-run",
        "--no-proxy-server",
        "--remote-debugging-port=0",
        f"--user-data-dir={profile}",
        url,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        told = profile / "DevToolsActivePort"
        await until(lambda: told.exists() and told.read_text().count("\n"), "DevTools", LIMIT_S)
        port = int(told.read_text().split()[0])
        async with connect(
            f"ws://127.0.0.1:{port}{await _target(port, url)}", max_size=None
        ) as connection:
            page = Page(connection)
            # At first there is an empty document, which is complete, too.
            await page.becomes(
                "document.readyState === 'complete' && location.href !== 'about:blank'"
            )
            yield page
    finally:
        os.killpg(browser.pid, signal.SIGKILL)
        await browser.wait()


async def _target(port: int, url: str) -> str:
    """Path of the page's own connection."""
    end = asyncio.get_running_loop().time() + LIMIT_S
    while asyncio.get_running_loop().time() < end:
        for target in await asyncio.to_thread(_targets, port):
            if target["type"] == "page" and target["url"].startswith(url):
                return "/devtools/page/" + str(target["id"])
        await asyncio.sleep(0.05)
    raise AssertionError(f"the browser did not open {url}")


def _targets(port: int) -> list[dict[str, Any]]:
    connection = HTTPConnection("127.0.0.1", port, timeout=LIMIT_S)
    try:
        connection.request("GET", "/json/list")
        found: list[dict[str, Any]] = json.loads(connection.getresponse().read())
    finally:
        connection.close()
    return found
