"""The peer of ROS 1 for ``services.py``: run by the Python that has rospy, so without simple_ros.

``rospy_peer.py server`` or ``rospy_peer.py client COUNT PACED``, with ``ROS_MASTER_URI`` set.
"""

import json
import statistics
import sys
import time

import rospy
from std_srvs.srv import SetBool, SetBoolResponse

WARM_UP = 300
PERIOD_S = 0.001


def serve():
    rospy.init_node("server", disable_signals=True)
    rospy.Service("bench", SetBool, lambda request: SetBoolResponse(request.data, "done"))
    print(json.dumps({"ready": ""}), flush=True)
    rospy.spin()


def spread(name, times):
    kept = sorted(times)
    return {
        name + "_p50_us": 1e6 * statistics.median(kept),
        name + "_p99_us": 1e6 * kept[int(0.99 * len(kept))],
    }


def measure(count, paced):
    rospy.init_node("client", disable_signals=True)
    rospy.wait_for_service("bench", timeout=10)
    proxy = rospy.ServiceProxy("bench", SetBool, persistent=True)
    for _ in range(WARM_UP):
        proxy(True)
    clock = time.perf_counter
    times = []
    begun = clock()
    for _ in range(count):
        sent = clock()
        if not proxy(True).success:
            raise SystemExit("a wrong answer")
        times.append(clock() - sent)
    report = {"per_second": count / (clock() - begun)}
    report.update(spread("sequential", times))
    due, times = clock(), []
    for _ in range(paced):
        due += PERIOD_S
        time.sleep(max(0.0, due - clock()))
        sent = clock()
        proxy(True)
        times.append(clock() - sent)
    report.update(spread("paced", times))
    print(json.dumps(report), flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "server":
        serve()
    else:
        measure(int(sys.argv[2]), int(sys.argv[3]))
