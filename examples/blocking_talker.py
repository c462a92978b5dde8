"""The blocking face: a publisher and a timer, with no event loop in sight."""

from simple_ros import NodeHandle, SystemManager, TimerEvent
from simple_ros.msg.std_msgs import String

system = SystemManager.instance()
system.init("blocking_talker")
publisher = NodeHandle().advertise("chatter", String)
count = 0


def tick(event: TimerEvent) -> None:
    """Runs in the thread that spins."""
    global count
    count += 1
    publisher.publish(String(data=f"hello {count}"))


NodeHandle().create_timer(0.1, tick)
system.spin()
