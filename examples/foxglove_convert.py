"""Foxglove: what the bridge makes of a message, without a bridge."""

from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan as ShownScan

from simple_ros.foxglove.convert import Context, converters_for
from simple_ros.msg.sensor_msgs import LaserScan
from simple_ros.msg.std_msgs import Header

scan = LaserScan(header=Header(frame_id="laser"), angle_min=-0.5, angle_increment=0.5)
scan.range_max = 10.0
scan.ranges.extend([1.0, 2.0, 50.0])

(converter,) = converters_for("sensor_msgs.LaserScan")
context = Context(receive_time_ns=1_000_000_000, topic="/scan")
shown = ShownScan.FromString(converter.convert(scan.SerializeToString(), context))

print(f"/scan{converter.suffix} carries {converter.schema_name}")
print(f"from {shown.start_angle} to {shown.end_angle} rad in frame {shown.frame_id}")
print(f"ranges {list(shown.ranges)}")
