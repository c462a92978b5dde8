"""``simple-ros demo wireless``: a robot on a simulated radio link, with engines and without."""

from simple_ros_hub.demo.command import wireless

__all__ = ["wireless"]
