"""Calls of a service by other middleware: ``calls_peer.py KIND server|client CALLS``, in the environment of the rival.

``zmq``: REQ/REP, and a DEALER for many at a time; ``zenoh``: a queryable and a querier; ``grpc``: unary calls of
``grpc.aio``; ``rospy``: ``persistent=True``, one at a time only; ``rclpy``: the same, as its
services keep 10 requests and lose the others. ROS peers carry
their own SetBool, the others the one of protobuf.
"""

import asyncio
import json
import os
import socket
import threading

import lean  # noqa: F401

from simple_ros.benchmark.calls import (
    answer,
    answer_bytes,
    check,
    measured,
    measured_blocking,
    question,
    run_calls,
)
from simple_ros.benchmark.sink import say

HOST = "127.0.0.1"


def ask():
    return question().SerializeToString()


# -- ZeroMQ ----------------------------------------------------------------------------------------


def zmq_server(calls):
    import zmq

    router = zmq.Context.instance().socket(zmq.ROUTER)  # serves REQ and DEALER alike
    say(ready=router.bind_to_random_port(f"tcp://{HOST}"))
    while True:
        *envelope, data = router.recv_multipart()
        router.send_multipart([*envelope, answer_bytes(data)])


def zmq_client(calls):
    import zmq

    def connected(kind):
        made = zmq.Context.instance().socket(kind)
        made.connect(f"tcp://{HOST}:{calls.at}")
        return made

    req, dealer = connected(zmq.REQ), connected(zmq.DEALER)

    def call():
        req.send(ask())
        check(req.recv())

    def many(count):
        for _ in range(count):
            dealer.send_multipart([b"", ask()])
        for _ in range(count):
            check(dealer.recv_multipart()[-1])

    return measured_blocking(call, calls, many)


# -- Zenoh -----------------------------------------------------------------------------------------


def zenoh_session(port, role):
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5(f"{role}/endpoints", json.dumps([f"tcp/{HOST}:{port}"]))
    return zenoh.open(config)


def zenoh_server(calls):
    with socket.create_server((HOST, 0)) as listening:
        port = listening.getsockname()[1]
    session = zenoh_session(port, "listen")
    session.declare_queryable(
        "bench", lambda query: query.reply("bench", answer_bytes(query.payload.to_bytes()))
    )
    say(ready=port)
    threading.Event().wait()


def zenoh_client(calls):
    session = zenoh_session(calls.at, "connect")
    querier = session.declare_querier("bench")
    while not querier.matching_status.matching:
        pass

    def take(replies):
        for reply in replies:
            check(reply.ok.payload.to_bytes())

    def many(count):
        for replies in [querier.get(payload=ask()) for _ in range(count)]:
            take(replies)

    return measured_blocking(lambda: take(querier.get(payload=ask())), calls, many)


# -- gRPC ------------------------------------------------------------------------------------------


async def grpc_server(calls):
    import grpc

    from simple_ros.msg.std_srvs_pb2 import SetBoolRequest, SetBoolResponse

    async def handle(request, context):
        return answer(request)

    handler = grpc.unary_unary_rpc_method_handler(
        handle, SetBoolRequest.FromString, SetBoolResponse.SerializeToString
    )
    server = grpc.aio.server()
    server.add_generic_rpc_handlers(
        (grpc.method_handlers_generic_handler("Bench", {"Call": handler}),)
    )
    port = server.add_insecure_port(f"{HOST}:0")
    await server.start()
    say(ready=port)
    await asyncio.Event().wait()


async def grpc_client(calls):
    import grpc

    from simple_ros.msg.std_srvs_pb2 import SetBoolRequest, SetBoolResponse

    async with grpc.aio.insecure_channel(f"{HOST}:{calls.at}") as channel:
        stub = channel.unary_unary(
            "/Bench/Call", SetBoolRequest.SerializeToString, SetBoolResponse.FromString
        )

        async def call():
            check(await stub(question()))

        return await measured(call, calls)


# -- ROS 1 and ROS 2 -------------------------------------------------------------------------------


def rospy_server(calls):
    import rospy
    from std_srvs.srv import SetBool, SetBoolResponse

    rospy.init_node("server", disable_signals=True, disable_rosout=True)
    rospy.Service("bench", SetBool, lambda request: SetBoolResponse(request.data, "done"))
    say(ready="")
    rospy.spin()


def rospy_client(calls):
    import rospy
    from std_srvs.srv import SetBool

    rospy.init_node("client", disable_signals=True, disable_rosout=True)
    rospy.wait_for_service("bench", timeout=10)
    proxy = rospy.ServiceProxy("bench", SetBool, persistent=True)
    return measured_blocking(lambda: check(proxy(True)), calls)


def rclpy_node(name):
    import rclpy

    rclpy.init(domain_id=int(os.environ["BENCH_DDS_DOMAIN"]))
    return rclpy.create_node(name, enable_rosout=False, start_parameter_services=False)


def rclpy_server(calls):
    import rclpy
    from std_srvs.srv import SetBool

    def handle(request, response):
        response.success, response.message = request.data, "done"
        return response

    node = rclpy_node("server")
    node.create_service(SetBool, "bench", handle)
    say(ready="")
    rclpy.spin(node)


def rclpy_client(calls):
    import rclpy
    from std_srvs.srv import SetBool

    node = rclpy_node("client")
    client = node.create_client(SetBool, "bench")
    client.wait_for_service(timeout_sec=10)
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)

    def call():
        future = client.call_async(SetBool.Request(data=True))
        executor.spin_until_future_complete(future, 10)
        check(future.result())

    return measured_blocking(call, calls)


run_calls(
    {
        "zmq": (zmq_server, zmq_client),
        "zenoh": (zenoh_server, zenoh_client),
        "grpc": (grpc_server, grpc_client),
        "rospy": (rospy_server, rospy_client),
        "rclpy": (rclpy_server, rclpy_client),
    }
)
