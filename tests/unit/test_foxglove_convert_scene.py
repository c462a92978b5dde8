"""Markers as updates of a Foxglove scene."""

from __future__ import annotations

import math

import numpy as np
import pytest
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given, settings
from hypothesis import strategies as st

from simple_ros.demos.quadrotor_markers import quadrotor_markers, step_marker
from simple_ros.foxglove.convert import Context, ConversionFailed, Converter, converters_for
from simple_ros.foxglove.convert.growing_lines import PIECE_POINTS, PIECES
from simple_ros.msg import visualization_msgs as vis
from simple_ros.msg.geometry_msgs import Point, Pose, Quaternion, Vector3
from simple_ros.msg.std_msgs import Header
from simple_ros.msg.visualization_msgs import ColorRGBA, Marker, MarkerArray
from simple_ros.tf.rigid import rotate

CONTEXT = Context(1_500_000_000_250_000_000, "/marks", "map")
NOW = Timestamp(seconds=1_500_000_000, nanos=250_000_000)
TURNED = Quaternion(z=math.sqrt(0.5), w=math.sqrt(0.5))
"""A quarter to the left."""


def converter(type_name: str = "visualization_msgs.Marker") -> Converter:
    (only,) = converters_for(type_name)
    return only


def update_of(marker: Marker | MarkerArray, by: Converter | None = None) -> SceneUpdate:
    by = by or converter(marker.DESCRIPTOR.full_name)
    result = by.convert(marker.SerializeToString(), CONTEXT)
    assert result is not None
    return SceneUpdate.FromString(result)


def entity_of(marker: Marker) -> SceneEntity:
    update = update_of(marker)
    assert not update.deletions
    (entity,) = update.entities
    return entity


def marker_of(kind: vis.MarkerType.ValueType, **fields: object) -> Marker:
    marker = Marker(
        ns="robot",
        id=7,
        type=kind,
        pose=Pose(position=Point(x=1, y=2, z=3), orientation=TURNED),
        scale=Vector3(x=0.5, y=0.25, z=0.125),
        color=ColorRGBA(r=0.5, g=0.25, b=0.75, a=1),
    )
    marker.MergeFrom(Marker(**fields))  # type: ignore[arg-type]
    return marker


def xyz(value: object) -> tuple[float, float, float]:
    return (value.x, value.y, value.z)  # type: ignore[attr-defined]


def rgba(value: object) -> tuple[float, ...]:
    return (value.r, value.g, value.b, value.a)  # type: ignore[attr-defined]


def points(*places: tuple[float, float, float]) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in places]


class TestEntity:
    def test_what_every_marker_tells(self) -> None:
        entity = entity_of(
            marker_of(
                vis.CUBE,
                header=Header(frame_id="/base", stamp=Timestamp(seconds=5, nanos=6)),
                frame_locked=True,
                lifetime=1.25,
            )
        )
        assert entity.id == "robot_7"
        assert entity.frame_id == "base"
        assert entity.timestamp == Timestamp(seconds=5, nanos=6)
        assert entity.frame_locked
        assert (entity.lifetime.seconds, entity.lifetime.nanos) == (1, 250_000_000)

    def test_what_the_form_of_cpp_leaves_out(self) -> None:
        entity = entity_of(Marker(type=vis.CUBE, color=ColorRGBA(r=1, a=1)))
        assert entity.id == "_0"
        assert entity.frame_id == "map"
        assert entity.timestamp == NOW
        assert entity.cubes[0].pose.orientation.w == 1
        assert entity.HasField("lifetime")
        assert entity.lifetime.ToNanoseconds() == 0

    @pytest.mark.parametrize("lifetime", [0.0, -1.0, math.inf, math.nan, 1e300])
    def test_for_ever(self, lifetime: float) -> None:
        assert entity_of(marker_of(vis.CUBE, lifetime=lifetime)).lifetime.ToNanoseconds() == 0

    def test_a_short_life_is_not_for_ever(self) -> None:
        assert entity_of(marker_of(vis.CUBE, lifetime=1e-12)).lifetime.ToNanoseconds() == 1

    def test_a_marker_that_cannot_be_drawn_takes_away_what_was_there(self) -> None:
        for marker in (marker_of(vis.CUBE), marker_of(vis.CUBE)):
            marker.pose.position.x = math.nan
            assert entity_of(marker).ListFields()[-1][0].name in {"lifetime", "id"}
        unknown = Marker.FromString(b"\x18\x63")  # type 99
        assert not entity_of(unknown).cubes

    def test_garbage(self) -> None:
        with pytest.raises(ConversionFailed, match="a message on /marks cannot be shown"):
            converter().convert(b"\x0a\xff", CONTEXT)


class TestSingleShapes:
    def test_cube_and_sphere(self) -> None:
        for shape in (
            *entity_of(marker_of(vis.CUBE)).cubes,
            *entity_of(marker_of(vis.SPHERE)).spheres,
        ):
            assert xyz(shape.pose.position) == (1, 2, 3)
            assert shape.pose.orientation.z == TURNED.z
            assert xyz(shape.size) == (0.5, 0.25, 0.125)
            assert rgba(shape.color) == (0.5, 0.25, 0.75, 1)

    def test_cylinder(self) -> None:
        (shape,) = entity_of(marker_of(vis.CYLINDER)).cylinders
        assert (shape.bottom_scale, shape.top_scale) == (1, 1)
        assert xyz(shape.size) == (0.5, 0.25, 0.125)

    def test_text(self) -> None:
        (text,) = entity_of(marker_of(vis.TEXT_VIEW_FACING, text="21 °C")).texts
        assert (text.text, text.font_size, text.billboard) == ("21 °C", 0.125, True)
        assert not text.scale_invariant
        assert xyz(text.pose.position) == (1, 2, 3)

    def test_mesh_by_url(self) -> None:
        marker = marker_of(vis.MESH_RESOURCE, mesh_resource="package://robot/arm.stl")
        (model,) = entity_of(marker).models
        assert (model.url, model.override_color) == ("package://robot/arm.stl", True)
        assert xyz(model.scale) == (0.5, 0.25, 0.125)
        marker.mesh_use_embedded_materials = True
        assert not entity_of(marker).models[0].override_color

    def test_mesh_that_comes_along(self) -> None:
        file = vis.MeshFile(filename="a.GLB", data=b"glTF")
        (model,) = entity_of(marker_of(vis.MESH_RESOURCE, mesh_file=file)).models
        assert (model.media_type, model.data, model.url) == ("model/gltf-binary", b"glTF", "")

    def test_arrow_along_the_pose(self) -> None:
        (arrow,) = entity_of(marker_of(vis.ARROW)).arrows
        assert arrow.shaft_length + arrow.head_length == pytest.approx(0.5)
        assert (arrow.shaft_diameter, arrow.head_diameter) == (0.25, 0.5)


class TestArrows:
    def test_from_point_to_point(self) -> None:
        marker = marker_of(vis.ARROW, points=points((0, 0, 0), (2, 0, 0)))
        (arrow,) = entity_of(marker).arrows
        assert (arrow.shaft_length, arrow.head_length) == (1.875, 0.125)
        assert (arrow.shaft_diameter, arrow.head_diameter) == (0.5, 0.25)
        assert xyz(arrow.pose.position) == pytest.approx((1, 2, 3))
        # The pose turns x to y.
        assert arrow.pose.orientation.z == pytest.approx(math.sqrt(0.5))

    @settings(deadline=None, derandomize=True)
    @given(st.tuples(*[st.floats(-10, 10)] * 3))
    def test_it_points_where_it_should(self, way: tuple[float, float, float]) -> None:
        length = math.hypot(*way)
        marker = Marker(
            type=vis.ARROW, points=points((1, 1, 1), (1 + way[0], 1 + way[1], 1 + way[2]))
        )
        arrows = entity_of(marker).arrows
        if length < 1e-6:
            return
        q = arrows[0].pose.orientation
        ahead = rotate((q.x, q.y, q.z, q.w), (length, 0, 0))
        assert ahead == pytest.approx(way, abs=1e-4)

    def test_straight_back(self) -> None:
        marker = Marker(type=vis.ARROW, points=points((0, 0, 0), (-1, 0, 0)))
        q = entity_of(marker).arrows[0].pose.orientation
        assert rotate((q.x, q.y, q.z, q.w), (1, 0, 0)) == pytest.approx((-1, 0, 0))

    def test_no_length_no_arrow(self) -> None:
        assert not entity_of(marker_of(vis.ARROW, points=points((1, 1, 1), (1, 1, 1)))).arrows
        bad = points((0, 0, 0), (math.nan, 0, 0))
        assert not entity_of(marker_of(vis.ARROW, points=bad)).arrows

    def test_strip(self) -> None:
        at = points((0, 0, 0), (1, 0, 0), (1, 1, 0))
        arrows = entity_of(Marker(type=vis.ARROW_STRIP, points=at)).arrows
        assert [xyz(arrow.pose.position) for arrow in arrows] == [(0, 0, 0), (1, 0, 0)]
        # Where the scale says nothing, the head is a share of the length.
        assert arrows[0].head_length == pytest.approx(0.23)


class TestPoints:
    PLACES = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 2.0, 0.0), (0.0, 2.0, 1.0))
    COLORS = (
        (1.0, 0.0, 0.0, 1.0),
        (0.0, 1.0, 0.0, 1.0),
        (0.0, 0.0, 1.0, 1.0),
        (0.0, 0.0, 0.0, 0.5),
    )

    def marker(self, kind: vis.MarkerType.ValueType, colored: int = 0, count: int = 4) -> Marker:
        colors = [ColorRGBA(r=r, g=g, b=b, a=a) for r, g, b, a in self.COLORS[:colored]]
        return marker_of(kind, points=points(*self.PLACES[:count]), colors=colors)

    @pytest.mark.parametrize(
        ("kind", "drawn"),
        [(vis.LINE_STRIP, LinePrimitive.LINE_STRIP), (vis.LINE_LIST, LinePrimitive.LINE_LIST)],
    )
    def test_lines(self, kind: vis.MarkerType.ValueType, drawn: int) -> None:
        (line,) = entity_of(self.marker(kind, colored=4)).lines
        assert line.type == drawn
        assert line.thickness == 0.5
        assert not line.scale_invariant
        assert tuple(map(xyz, line.points)) == self.PLACES
        assert tuple(map(rgba, line.colors)) == self.COLORS
        assert xyz(line.pose.position) == (1, 2, 3)
        assert line.pose.orientation.z == TURNED.z

    def test_one_color_for_all(self) -> None:
        (line,) = entity_of(self.marker(vis.LINE_STRIP)).lines
        assert rgba(line.color) == (0.5, 0.25, 0.75, 1)
        assert not line.colors

    def test_half_a_line_is_left_out(self) -> None:
        (line,) = entity_of(self.marker(vis.LINE_LIST, count=3)).lines
        assert len(line.points) == 2

    def test_what_is_not_finite_is_left_out(self) -> None:
        marker = self.marker(vis.LINE_LIST, colored=4)
        marker.points[1].y = math.inf
        (line,) = entity_of(marker).lines
        assert tuple(map(xyz, line.points)) == self.PLACES[2:]
        assert tuple(map(rgba, line.colors)) == self.COLORS[2:]

    @pytest.mark.parametrize(
        ("kind", "field", "size"),
        [
            (vis.CUBE_LIST, "cubes", (0.5, 0.25, 0.125)),
            (vis.SPHERE_LIST, "spheres", (0.5, 0.25, 0.125)),
            (vis.POINTS, "cubes", (0.5, 0.25, 0.5)),
        ],
    )
    def test_bodies(
        self, kind: vis.MarkerType.ValueType, field: str, size: tuple[float, float, float]
    ) -> None:
        bodies = getattr(entity_of(self.marker(kind, colored=4)), field)
        q = (TURNED.x, TURNED.y, TURNED.z, TURNED.w)
        for body, place, color in zip(bodies, self.PLACES, self.COLORS, strict=True):
            dx, dy, dz = rotate(q, place)
            assert xyz(body.pose.position) == pytest.approx((1 + dx, 2 + dy, 3 + dz))
            assert body.pose.orientation.w == pytest.approx(TURNED.w)
            assert xyz(body.size) == size
            assert rgba(body.color) == color

    def test_triangles(self) -> None:
        (triangles,) = entity_of(self.marker(vis.TRIANGLE_LIST, count=4)).triangles
        scaled = [(0.5 * x, 0.25 * y, 0.125 * z) for x, y, z in self.PLACES[:3]]
        assert [xyz(point) for point in triangles.points] == scaled
        assert rgba(triangles.color) == (0.5, 0.25, 0.75, 1)

    def test_triangles_without_a_scale(self) -> None:
        marker = Marker(type=vis.TRIANGLE_LIST, points=points(*self.PLACES[:3]))
        (triangles,) = entity_of(marker).triangles
        assert tuple(map(xyz, triangles.points)) == self.PLACES[:3]

    def test_a_color_for_each_triangle(self) -> None:
        marker = self.marker(vis.TRIANGLE_LIST, count=3, colored=1)
        (triangles,) = entity_of(marker).triangles
        assert [rgba(color) for color in triangles.colors] == 3 * [self.COLORS[0]]

    @settings(deadline=None, derandomize=True)
    @given(
        st.lists(
            st.tuples(*[st.floats(allow_nan=False, allow_infinity=False, width=32)] * 3),
            max_size=20,
        )
    )
    def test_any_points(self, places: list[tuple[float, float, float]]) -> None:
        (line,) = entity_of(Marker(type=vis.LINE_STRIP, points=points(*places))).lines
        assert [xyz(point) for point in line.points] == places


class TestActions:
    def test_delete(self) -> None:
        update = update_of(marker_of(vis.CUBE, action=vis.DELETE))
        assert not update.entities
        (deletion,) = update.deletions
        assert (deletion.type, deletion.id) == (SceneEntityDeletion.MATCHING_ID, "robot_7")
        assert deletion.timestamp == NOW

    def test_a_deletion_is_as_late_as_its_stamp(self) -> None:
        ahead = Timestamp(seconds=NOW.seconds + 5)
        marker = marker_of(vis.CUBE, action=vis.DELETE, header=Header(stamp=ahead))
        assert update_of(marker).deletions[0].timestamp == ahead

    def test_delete_all(self) -> None:
        (deletion,) = update_of(Marker(action=vis.DELETEALL)).deletions
        assert deletion.type == SceneEntityDeletion.ALL

    def test_the_order_in_an_array_counts(self) -> None:
        array = MarkerArray(
            markers=[
                Marker(ns="early", type=vis.CUBE),
                Marker(ns="gone", action=vis.DELETE),
                Marker(action=vis.DELETEALL),
                Marker(ns="a", type=vis.CUBE),
                Marker(ns="b", type=vis.CUBE),
                Marker(ns="b", action=vis.DELETE),
                Marker(ns="a", type=vis.SPHERE),
                Marker(ns="c", action=vis.DELETE),
                Marker(ns="c", type=vis.CUBE),
            ]
        )
        update = update_of(array)
        kinds = [(deletion.type, deletion.id) for deletion in update.deletions]
        matching = SceneEntityDeletion.MATCHING_ID
        assert kinds == [(SceneEntityDeletion.ALL, ""), (matching, "b_0"), (matching, "c_0")]
        assert [entity.id for entity in update.entities] == ["a_0", "c_0"]
        assert update.entities[0].spheres

    def test_the_quadrotor(self) -> None:
        pose = Pose(position=Point(x=2), orientation=Quaternion(w=1))
        before, after = (update_of(quadrotor_markers(pose, angle)) for angle in (0.0, 0.3))
        assert [entity.id for entity in before.entities] == [f"quadrotor_{n}" for n in range(9)]
        assert len(before.entities[0].cubes) == 1
        assert all(len(entity.cylinders) == 1 for entity in before.entities[1:])
        for still in range(5):
            assert before.entities[still] == after.entities[still]
        for turning in range(5, 9):
            assert before.entities[turning] != after.entities[turning]


class TestGrowingLines:
    def step(self, number: int) -> Marker:
        return step_marker(Point(x=number), Point(x=number + 1))

    def steps(self, by: Converter, first: int, last: int) -> SceneUpdate:
        update = SceneUpdate()
        for number in range(first, last):
            update = update_of(self.step(number), by)
        return update

    @staticmethod
    def newest(update: SceneUpdate) -> list[float]:
        (entity,) = (e for e in update.entities if e.id == "quad_path_incremental_1")
        return [point.x for point in entity.lines[0].points]

    def test_steps_make_a_line(self) -> None:
        by = converter()
        update = self.steps(by, 0, 5)
        assert self.newest(update) == [0, 1, 2, 3, 4, 5]
        entity = update.entities[0]
        assert entity.lifetime.ToNanoseconds() == 0
        assert entity.lines[0].thickness == pytest.approx(0.15)
        # A step that was lost is bridged.
        assert self.newest(self.steps(by, 8, 9)) == [0, 1, 2, 3, 4, 5, 8, 9]

    def test_the_whole_line_is_shown_in_pieces(self) -> None:
        by = converter()
        self.steps(by, 0, 5 * PIECE_POINTS)
        seen: set[float] = set()
        for number in range(5 * PIECE_POINTS, 5 * PIECE_POINTS + 6):
            update = update_of(self.step(number), by)
            assert sum(len(e.lines[0].points) for e in update.entities) <= 2 * PIECE_POINTS
            seen.update(p.x for e in update.entities for p in e.lines[0].points)
        assert seen == set(range(5 * PIECE_POINTS + 7))

    def test_pieces_join(self) -> None:
        by = converter()
        pieces: dict[str, list[float]] = {}
        for number in range(3 * PIECE_POINTS):
            for entity in update_of(self.step(number), by).entities:
                pieces[entity.id] = [point.x for point in entity.lines[0].points]
        ends = sorted((xs[0], xs[-1]) for xs in pieces.values())
        assert [end for _, end in ends[:-1]] == [start for start, _ in ends[1:]]

    def test_it_is_bounded(self) -> None:
        by = converter()
        ids: set[str] = set()
        for number in range(PIECES + 3):
            start = Point(x=number * 1000)
            for step in range(PIECE_POINTS):
                marker = step_marker(start, Point(x=start.x + step + 1))
                start = marker.points[1]
                ids.update(entity.id for entity in update_of(marker, by).entities)
        assert len(ids) == PIECES

    def test_deleting_takes_all_pieces(self) -> None:
        by = converter()
        self.steps(by, 0, 2 * PIECE_POINTS)
        gone = self.step(0)
        gone.action = vis.DELETE
        name = "quad_path_incremental_1"
        assert [d.id for d in update_of(gone, by).deletions] == [name, f"{name}/0", f"{name}/1"]
        assert self.newest(self.steps(by, 0, 1)) == [0, 1]
        update_of(Marker(action=vis.DELETEALL), by)
        assert self.newest(self.steps(by, 4, 5)) == [4, 5]

    def test_a_whole_line_begins_anew(self) -> None:
        by = converter()
        self.steps(by, 0, PIECE_POINTS + 5)
        whole = self.step(0)
        whole.points.extend(points((7, 0, 0)))
        update = update_of(whole, by)
        assert [d.id for d in update.deletions] == ["quad_path_incremental_1/0"]
        assert self.newest(update) == [0, 1, 7]

    def test_without_points_the_pose_is_the_step(self) -> None:
        by = converter()
        for x in (1, 2):
            marker = Marker(type=vis.LINE_STRIP, lifetime=-1, pose=Pose(position=Point(x=x)))
            update = update_of(marker, by)
        assert [point.x for point in update.entities[0].lines[0].points] == [1, 2]

    def test_other_lines_do_not_grow(self) -> None:
        by = converter()
        for lifetime in (0, 50):
            marker = Marker(
                type=vis.LINE_STRIP, lifetime=lifetime, points=points((0, 0, 0), (1, 1, 1))
            )
            for _ in range(3):
                assert len(update_of(marker, by).entities[0].lines[0].points) == 2

    def test_channels_share_nothing(self) -> None:
        self.steps(converter(), 0, 5)
        assert self.newest(self.steps(converter(), 0, 1)) == [0, 1]

    def test_the_pose_of_a_step_counts(self) -> None:
        marker = Marker(
            type=vis.LINE_STRIP,
            lifetime=-1,
            pose=Pose(position=Point(x=1), orientation=TURNED),
            points=points((0, 0, 0), (1, 0, 0)),
        )
        (line,) = entity_of(marker).lines
        assert np.allclose([xyz(p) for p in line.points], [(1, 0, 0), (1, 1, 0)])
        assert line.pose.orientation.w == 1
