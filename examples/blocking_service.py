"""The blocking face: a service and its client in one process, with two threads that spin."""

from simple_ros import CallbackGroup, NodeHandle, SystemManager, TimerEvent
from simple_ros.msg.std_srvs import SetBool, SetBoolRequest, SetBoolResponse

node = NodeHandle("lamp")


def switch(request: SetBoolRequest) -> SetBoolResponse:
    """Runs in a thread that spins."""
    return SetBoolResponse(success=True, message="on" if request.data else "off")


node.advertise_service("lamp", SetBool, switch)
client = node.service_client("lamp", SetBool, timeout=2.0)


def press(event: TimerEvent) -> None:
    """In a group of its own: while it waits for the answer, the handler runs in the other thread."""
    print(f"the lamp is {client.call(SetBoolRequest(data=True)).message}", flush=True)
    SystemManager.instance().shutdown()


node.create_timer(0.1, press, oneshot=True, group=CallbackGroup())
node.spin(threads=2)
