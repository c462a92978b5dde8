"""The blocking face: callbacks run in the thread that spins."""

from simple_ros import NodeHandle, SystemManager
from simple_ros.msg.std_msgs import String


def on_chatter(message: String) -> None:
    print(f"heard: {message.data}", flush=True)


system = SystemManager.instance()
system.init("blocking_listener")
NodeHandle().subscribe("chatter", String, on_chatter)
system.spin()
