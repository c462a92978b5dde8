"""Looking at a page of `support.devtools` and pressing what is on it, as a person would: at places, by keys."""

from __future__ import annotations

import asyncio
import base64
import os
from pathlib import Path

from support.devtools import Page

PICTURES = os.environ.get("SIMPLE_ROS_TEST_PICTURES")
"""A directory for pictures that somebody wants to look at."""


async def screen(page: Page, width: int, height: int, *, is_phone: bool) -> None:
    """Give the page a screen of that size in CSS pixels."""
    await page.call(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=height,
        deviceScaleFactor=2 if is_phone else 1,
        mobile=is_phone,
    )


async def click(page: Page, selector: str) -> None:
    """Press and release the mouse in the middle of an element, which must be what lies there."""
    place = await page.evaluate(
        f"(() => {{ const one = document.querySelector({selector!r});"
        "one.scrollIntoView({block: 'center'}); const box = one.getBoundingClientRect();"
        "const x = box.x + box.width / 2, y = box.y + box.height / 2;"
        "return {x, y, hit: one.contains(document.elementFromPoint(x, y))}; })()"
    )
    assert place.pop("hit"), f"{selector} is covered by something else"
    for kind in ("mousePressed", "mouseReleased"):
        await page.call("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **place)


async def choose(page: Page, selector: str, text: str) -> None:
    """Choose an entry of a list by its first letters, by the keyboard."""
    await page.evaluate(f"document.querySelector({selector!r}).focus()")
    for letter in text:
        await page.call("Input.dispatchKeyEvent", type="keyDown", text=letter, key=letter)
        await page.call("Input.dispatchKeyEvent", type="keyUp", key=letter)


async def fits(page: Page) -> None:
    """Nothing sticks out to the side, neither of the page nor of what scrolls in it."""
    assert await page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    wide = (
        "[...document.querySelectorAll('.scroll, section')]"
        ".filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent)"
    )
    assert await page.evaluate(wide) == []


async def picture(page: Page, name: str) -> None:
    """Write what is on the screen and below it, if somebody wants to look at it."""
    if PICTURES:
        said = await page.call("Page.captureScreenshot", captureBeyondViewport=True)
        data = base64.b64decode(said["data"])
        await asyncio.to_thread(Path(PICTURES, f"{name}.png").write_bytes, data)
