"""``simple-ros demo turtlesim``: two turtles over a simulated mobile network that runs short and recovers."""

from simple_ros_engines.network_exposure.demo.command import turtlesim

__all__ = ["turtlesim"]
