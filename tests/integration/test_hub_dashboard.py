"""The dashboard in a real browser: what a phone shows, the map, and switches that are really pressed."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
from support.browser import BROWSER
from support.devtools import Page, opened
from support.hubs import SYNTHETIC, Watcher, end_all, hub_process, watcher
from support.pressing import choose, click, fits, picture, screen
from support.waiting import until

from simple_ros.msg.arrays import numpy_to_occupancy_grid
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import OccupancyGrid
from simple_ros.qos import LATCHED
from simple_ros_master import Master

pytestmark = pytest.mark.skipif(BROWSER is None, reason="needs chromium")

LONG_S = 60.0
ROW = "#component-cross_domain_engine"


@asynccontextmanager
async def page_of_a_hub(master: Master, place: Path) -> AsyncIterator[tuple[Page, Watcher]]:
    """A hub in operation, with its page open on a phone."""
    options = (*SYNTHETIC, "--cell", "telemetry", "--dashboard", "0")
    async with watcher(master) as seen:
        try:
            async with hub_process(master, place, *options, discovery_time=0.1):
                await until(lambda: seen.operates, "operation", LONG_S)
                said = "Dashboard at "
                await until(lambda: any(t.startswith(said) for t in seen.texts()), said)
                url = next(t for t in seen.texts() if t.startswith(said)).split()[-1]
                async with opened(url, place / "profile") as page:
                    await page.becomes(f"document.querySelector('{ROW} select')", "components")
                    await page.evaluate(
                        "window.faults = []; addEventListener('error', (e) => faults.push(e.message))"
                    )
                    await screen(page, 390, 844, is_phone=True)
                    yield page, seen
                    assert await page.evaluate("faults") == []
        finally:
            end_all(place)


async def color_at(page: Page, x: float, y: float) -> list[int]:
    """Of the map's canvas; x to the right, y upwards, 0 to 1."""
    found: list[int] = await page.evaluate(
        "(() => { const map = document.getElementById('map');"
        f"const x = Math.floor({x} * map.width), y = Math.floor((1 - {y}) * map.height);"
        "return [...map.getContext('2d').getImageData(x, y, 1, 1).data].slice(0, 3); })()"
    )
    return found


async def test_phone_map_and_switches(master: Master, tmp_path: Path) -> None:
    async with page_of_a_hub(master, tmp_path) as (page, seen):
        await page.becomes("document.querySelector('#links .name')", "a link")
        await _a_phone_shows_all(page)
        await _a_map_appears(page, seen)
        await _switches_work(page, seen)
        await screen(page, 1280, 800, is_phone=False)
        await page.becomes("getComputedStyle(document.querySelector('th')).display !== 'none'")
        await fits(page)
        await picture(page, "desk")


async def _a_phone_shows_all(page: Page) -> None:
    await fits(page)
    titles = "[...document.querySelectorAll('#links td')].map((one) => one.dataset.title)"
    assert "RTT (ms)" in await page.evaluate(titles)
    # What is pressed by fingers is large enough for them.
    sizes = "[...document.querySelectorAll('button')].map((b) => b.getBoundingClientRect().height)"
    assert min(await page.evaluate(sizes)) >= 44


async def _a_map_appears(page: Page, seen: Watcher) -> None:
    assert await page.evaluate("document.getElementById('map-section').hidden")
    cells = np.zeros((20, 40), np.int8)
    cells[:10, 20:], cells[10:, :20], cells[10:, 20:] = 49, 100, -1
    maps = await seen.node.advertise("/wireless_ros/enhanced_map", OccupancyGrid, qos=LATCHED)
    maps.publish(numpy_to_occupancy_grid(cells, 0.5))
    await page.becomes("!document.getElementById('map-section').hidden", "a map")
    # Row 0 of a grid lies at the bottom.
    assert await color_at(page, 0.25, 0.25) == [40, 190, 70]
    assert await color_at(page, 0.75, 0.25) == [240, 40, 70]
    assert await color_at(page, 0.25, 0.75) == [20, 20, 20]
    assert await color_at(page, 0.75, 0.75) == [128, 128, 128]
    poses = await seen.node.advertise("/robot/pose", PoseStamped, qos=LATCHED)
    pose = PoseStamped()
    pose.pose.position.x, pose.pose.position.y = 5.0, 2.5
    poses.publish(pose)
    await page.becomes("document.getElementById('map-text').textContent.includes('5.0, 2.5')")
    assert await color_at(page, 0.25, 0.25) == [0, 102, 255]
    await fits(page)
    await picture(page, "phone")


async def _switches_work(page: Page, seen: Watcher) -> None:
    await choose(page, f"{ROW} select", "burst")
    await until(lambda: seen.component("cross_domain_engine").mode == "burst", "burst", LONG_S)
    await choose(page, "#policy", "RELIABILITY")
    await until(lambda: "Global Policy Updated: RELIABILITY_FOCUS" in seen.texts(), "a policy")
    await page.becomes("document.getElementById('answer').textContent.includes('policy is')")
    button = "#component-telemetry_cell button"
    await click(page, button)
    await until(lambda: seen.component("telemetry_cell").state == "stopped", "a stop", LONG_S)
    await page.becomes(f"document.querySelector('{button}').textContent === 'start'")
    await click(page, button)
    await until(lambda: seen.component("telemetry_cell").state == "active", "a start", LONG_S)
    await page.becomes("document.getElementById('events').textContent.includes('burst')")
