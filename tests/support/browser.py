"""Pages of a folder in a real browser without a screen, which tell what came of it."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from support.waiting import until

_FOUND = shutil.which("chromium")
# A snap may not use the directory that it is given.
BROWSER = None if _FOUND is None or _FOUND.startswith("/snap/") else _FOUND
OTHER_HOST = "robot.example"
"""A name that the browser, and nobody else, takes for this host."""


class _Handler(SimpleHTTPRequestHandler):
    extensions_map = SimpleHTTPRequestHandler.extensions_map | {".mjs": "text/javascript"}

    def __init__(self, *arguments: Any, told: list[str], **options: Any) -> None:
        self._told = told
        super().__init__(*arguments, **options)

    def do_POST(self) -> None:
        self._told.append(self.rfile.read(int(self.headers["Content-Length"])).decode())
        self.send_response(204)
        self.end_headers()

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002
        """Say nothing."""


@asynccontextmanager
async def pages(folder: Path, told: list[str]) -> AsyncIterator[int]:
    """Serve the files of a folder; what pages post is added to ``told``. Gives the port."""
    handler = partial(_Handler, directory=str(folder), told=told)
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        await asyncio.to_thread(server.shutdown)
        thread.join()
        server.server_close()


async def told_by(folder: Path, page: str, profile: Path, host: str = "localhost") -> str:
    """What a page posts that is opened in the browser.

    Args:
        folder: Where the page and what it needs are.
        page: Its name there, with what follows ``#``.
        profile: An empty directory for the browser.
        host: The page's host: this one, or `OTHER_HOST`.
    """
    assert BROWSER is not None
    told: list[str] = []
    async with pages(folder, told) as port:
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
            f"--user-data-dir={profile}",
            f"--host-resolver-rules=MAP {OTHER_HOST} 127.0.0.1",
            f"http://{host}:{port}/{page}",
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            await until(lambda: told, f"{page} tells what came of it", 40)
        finally:
            os.killpg(browser.pid, signal.SIGKILL)
            await browser.wait()
    return told[0]
