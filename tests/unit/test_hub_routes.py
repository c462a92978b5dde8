"""Which of several links is taken."""

from __future__ import annotations

import pytest

from simple_ros.errors import ConfigError
from simple_ros_hub.routes import LinkHealth, RouteJudge, routes_of


class Links:
    """Links that are heard of ten times a second."""

    def __init__(self, judge: RouteJudge) -> None:
        self.judge = judge
        self.now = 100.0
        self.quality: dict[str, float | None] = {}
        self.known: dict[str, LinkHealth] = {}
        self.changes: list[str] = []

    def run(self, seconds: float, **quality: float | None) -> None:
        self.quality |= quality
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            for link, value in self.quality.items():
                if value is not None:
                    self.known[link] = LinkHealth(value, self.now)
            if self.judge.update(self.known, self.now):
                self.changes.append(f"{self.judge.route}: {self.judge.reason}")


@pytest.fixture
def links() -> Links:
    made = Links(RouteJudge(("wifi", "lte")))
    made.run(10, wifi=0.9, lte=0.6)
    assert made.changes == []
    return made


def test_a_link_that_gets_bad_is_left_and_taken_again_once_it_was_good(links: Links) -> None:
    links.run(0.4, wifi=0.1)
    assert links.judge.route == "wifi"
    links.run(0.3)
    assert links.changes == ["lte: wifi has quality 0.10"]
    links.run(4.8, wifi=0.9)
    assert links.judge.route == "lte"
    links.run(0.5)
    assert links.changes[1:] == ["wifi: wifi is good again"]


def test_a_silent_link_is_left(links: Links) -> None:
    links.run(3, wifi=None)
    assert links.judge.route == "lte"
    assert "wifi is silent for 2." in links.changes[0]


def test_a_short_dip_is_no_reason(links: Links) -> None:
    for _ in range(20):
        links.run(0.3, wifi=0.1)
        links.run(0.2, wifi=0.9)
    assert links.changes == []


def test_what_flaps_at_the_threshold_is_not_come_back_to(links: Links) -> None:
    links.run(1, wifi=0.1)
    for _ in range(50):
        links.run(1, wifi=0.26)
        links.run(1, wifi=0.31)
    assert links.judge.route == "lte"


def test_where_none_works_nothing_changes(links: Links) -> None:
    links.run(10, wifi=0.1, lte=0.0)
    assert links.changes == []
    links.run(1, lte=0.5)
    assert links.judge.route == "lte"


def test_before_anything_is_known_the_preferred_is_taken_or_that_of_before() -> None:
    fresh = Links(RouteJudge(("wifi", "lte")))
    fresh.run(5)
    assert (fresh.judge.route, fresh.changes) == ("wifi", [])
    assert RouteJudge(("wifi", "lte"), "lte").route == "lte"
    assert RouteJudge(("wifi", "lte"), "gone").route == "wifi"


def test_lists_of_links() -> None:
    assert routes_of("") == ()
    assert routes_of(" wifi, lte ,") == ("wifi", "lte")
    with pytest.raises(ConfigError, match="twice"):
        routes_of("wifi,lte,wifi")
    with pytest.raises(ConfigError, match="needs a link"):
        RouteJudge(())
