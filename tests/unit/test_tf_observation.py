from __future__ import annotations

import pytest

from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.tf.observation import Observation
from simple_ros.time import Time


def edge(parent: str, child: str, seconds: float = 1.0, w: float = 1.0) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.CopyFrom(Time.of(seconds).to_msg())
    message.transform.rotation.w = w
    return message


def robot() -> Observation:
    seen = Observation()
    for tenth in range(11):
        now = 100 + tenth / 10
        seen.receive(edge("map", "odom", now - 0.02), now, is_static=False)
        seen.receive(edge("/odom", "/base", now - 0.05), now, is_static=False)
    for child in ("camera", "laser"):
        seen.receive(edge("base", child), 100, is_static=True)
    return seen


def drawn(seen: Observation, now_s: float = 101) -> list[str]:
    return [f"{row.prefix}{row.frame}" for row in seen.rows(now_s)]


def texts(seen: Observation, now_s: float = 101) -> list[str]:
    return [problem.text for problem in seen.problems(now_s)]


def test_edges() -> None:
    base, camera, _, odom = robot().edges(101.5)
    assert (base.frame, base.parent, base.count) == ("base", "odom", 11)
    assert base.rate_hz == pytest.approx(10)
    assert base.age_s == pytest.approx(0.55)
    assert base.delay_s == pytest.approx(0.05)
    assert base.max_delay_s == pytest.approx(0.05)
    assert odom.delay_s == pytest.approx(0.02)
    assert camera.is_static
    assert (camera.rate_hz, camera.age_s, camera.delay_s) == (None, None, None)


def test_tree() -> None:
    seen = robot()
    assert seen.roots() == ("map",)
    assert drawn(seen) == ["map", "└─ odom", "   └─ base", "      ├─ camera", "      └─ laser"]
    assert texts(seen) == []


def test_two_trees() -> None:
    seen = robot()
    seen.receive(edge("world", "cup"), 100, is_static=True)
    assert drawn(seen)[-2:] == ["world", "└─ cup"]
    assert texts(seen) == ["there are 2 trees, with the roots 'map', 'world'"]


def test_circle_is_drawn_once_and_told() -> None:
    seen = Observation()
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a"), ("c", "leaf")):
        seen.receive(edge(parent, child), 1, is_static=True)
    assert seen.roots() == ()
    assert sorted(row.frame for row in seen.rows(1)) == ["a", "b", "c", "leaf"]
    (text,) = texts(seen, 1)
    assert "form a circle" in text


def test_what_is_broken() -> None:
    seen = robot()
    seen.receive(edge("odom", "camera"), 100, is_static=True)
    seen.receive(edge("map", "bad", w=3), 100, is_static=False)
    seen.receive(edge("map", "ahead", 110), 101, is_static=False)
    found = texts(seen, 103)
    assert any("length 3" in text for text in found)
    assert "'camera' is sent with the parents 'base', 'odom'; two programs may send it" in found
    assert any("'base' is old" in text for text in found)
    assert any("7.0 s ahead" in text for text in found)
    seen.receive(edge("base", "camera"), 100, is_static=True)
    assert [edge.parent for edge in seen.edges(103) if edge.frame == "camera"] == ["base"]


def test_a_deep_tree() -> None:
    seen = Observation()
    for number in range(3000):
        seen.receive(edge(f"f{number}", f"f{number + 1}"), 1, is_static=True)
    assert len(seen.rows(1)) == 3001
