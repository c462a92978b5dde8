from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from simple_ros_master import Master


@pytest.fixture
async def master() -> AsyncIterator[Master]:
    """A Master of its own, in this process, on a free port."""
    async with Master(host="127.0.0.1", port=0) as running:
        yield running
