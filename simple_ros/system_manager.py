"""SystemManager and the blocking NodeHandle: the seed's own API, in Python spelling.

::

    from simple_ros import NodeHandle, SystemManager
    from simple_ros.msg.std_msgs import String

    system = SystemManager.instance()
    system.init("listener")
    NodeHandle().subscribe("chatter", String, lambda message: print(message.data))
    system.spin()
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import time
from types import FrameType
from typing import Any, Self

from simple_ros.blocking import BlockingNode
from simple_ros.executor import Executor
from simple_ros.message_queue import MessageQueue
from simple_ros.net.loop import BackgroundLoop
from simple_ros.net.transport import TransportChoice
from simple_ros.node import NodeHandle as AsyncNodeHandle
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc_client import RosRpcClient

__all__ = ["NodeHandle", "SystemManager"]


class SystemManager:
    """One per process: starts the node, spins its callbacks, ends it.

    Use `SystemManager.instance`.
    """

    _instance: SystemManager | None = None
    _instance_lock = threading.Lock()

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._loop: BackgroundLoop | None = None
        self._executor = Executor()
        self._node: AsyncNodeHandle | None = None
        self._nodes: list[BlockingNode] = []
        self._spinning: int | None = None
        self._old_handlers: dict[int, Any] = {}
        self._failure_told = False

    @classmethod
    def instance(cls) -> SystemManager:
        """The one of this process."""
        with cls._instance_lock:
            if cls._instance is None:
                cls._instance = cls()
            return cls._instance

    # -- life ----------------------------------------------------------------------------------

    def init(
        self,
        *args: int | str,
        port: int = 0,
        node_name: str = "",
        master: str | None = None,
        ip: str | None = None,
        transports: TransportChoice = None,
    ) -> None:
        """Start the node of this process: ``init()``, ``init(port)``, ``init(name)``, ``init(port, name)``.

        It listens at once and looks for the Master in the background. A node without a name gets
        ``node_`` and its process id (C++ simple_ros registers it with none, and it can never be reached).
        SIGINT and SIGTERM then end `spin`, or else the program, after a goodbye to the Master.

        Args:
            args: Port and name, as above.
            port: Port to listen on; 0 takes any free one.
            node_name: Name of the node.
            master: ``host:port`` of the Master; None takes ``SIMPLE_ROS_MASTER`` or the default.
            ip: Dotted IPv4 that peers see; None finds it.
            transports: How messages may travel, see `simple_ros.aio.NodeHandle`.

        Raises:
            RuntimeError: It was called before, with no `shutdown` in between.
            InvalidName: The name breaks the rules.
            AddressInUse: The port is taken.
        """
        for arg in args:
            if isinstance(arg, int):
                port = arg
            else:
                node_name = arg
        with self._lock:
            if self._node is not None:
                raise RuntimeError("SystemManager.init was called before; shut it down first")
            node = AsyncNodeHandle(
                node_name or f"node_{os.getpid()}",
                master=master,
                ip=ip,
                port=port,
                transports=transports,
            )
            if self._executor.is_stopped:
                self._executor = Executor()
            loop = self._started_loop()
            loop.run(node.start())
            loop.start(self._await_end(node))
            self._node = node
        self._take_signals()
        atexit.register(self.shutdown)

    def _started_loop(self) -> BackgroundLoop:
        if self._loop is None:
            self._loop = BackgroundLoop()
        return self._loop

    async def _await_end(self, node: AsyncNodeHandle) -> None:
        """A node that lost its name, or was asked to end, ends the spin."""
        executor = self._executor
        await node.wait_ended()
        executor.stop()

    def shutdown(self) -> None:
        """Say goodbye, end every node of the process and every spin; twice does nothing more."""
        self._executor.stop()
        with self._lock:
            node, loop = self._node, self._loop
            nodes, self._nodes = self._nodes, []
            self._node = self._loop = None
        if loop is None:
            return
        for other in nodes:
            other.close()
        if node is not None:
            loop.run(node.close())
        loop.stop()
        self._give_signals_back()
        atexit.unregister(self.shutdown)

    @property
    def is_running(self) -> bool:
        """Whether it is between `init` and its end."""
        return self._node is not None and not self._executor.is_stopped

    # -- signals -------------------------------------------------------------------------------

    def _take_signals(self) -> None:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                if number not in self._old_handlers:
                    self._old_handlers[number] = signal.signal(number, self._signalled)

    def _give_signals_back(self) -> None:
        if threading.current_thread() is threading.main_thread():
            for number, handler in self._old_handlers.items():
                signal.signal(number, handler)
            self._old_handlers.clear()

    def _signalled(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002
        if self._spinning == threading.get_ident():
            self._executor.stop()
        else:
            sys.exit(0)

    # -- callbacks -----------------------------------------------------------------------------

    def spin(self, threads: int = 1) -> None:
        """Run callbacks and timers as they come, until `shutdown`, SIGINT or SIGTERM.

        Args:
            threads: How many threads run them; see `CallbackGroup`.

        Raises:
            RuntimeError: `init` was not called.
            NodeNameTaken: A newer node runs under this node's name.
        """
        self._checked_node()
        self._spinning = threading.get_ident()
        try:
            self._executor.spin(threads)
        finally:
            self._spinning = None
        self._raise_failure()

    def spin_once(self, timeout: float | None = 0.0) -> int:
        """Run everything that is due, waiting up to ``timeout`` seconds for the first of it.

        (C++ simple_ros handles one message.)

        Returns:
            How many callbacks and timers were called.

        Raises:
            RuntimeError: `init` was not called.
            NodeNameTaken: A newer node runs under this node's name.
        """
        self._checked_node()
        calls = self._executor.spin_once(timeout)
        self._raise_failure()
        return calls

    def _raise_failure(self) -> None:
        node = self._node
        if node is not None and node.failure is not None:
            raise node.failure

    # -- getters -------------------------------------------------------------------------------

    def get_message_queue(self) -> MessageQueue:
        """Where received messages wait for the thread that spins."""
        return self._executor.queue

    def get_poll_manager(self) -> AsyncNodeHandle:
        """The asyncio node that does the network work on the background loop."""
        return self._checked_node()

    def get_event_loop(self) -> BackgroundLoop:
        """The background loop."""
        self._checked_node()
        return self._started_loop()

    def get_rpc_client(self) -> RosRpcClient:
        """Blocking calls to the Master."""
        return RosRpcClient(self._started_loop(), self._checked_node().master)

    def get_node_info(self) -> ros.NodeInfo:
        """Name and address of the node, as registered."""
        return self._checked_node().node_info()

    def now(self) -> float:
        """Seconds since 1970-01-01 UTC, with fractions."""
        return time.time()

    def _checked_node(self) -> AsyncNodeHandle:
        if self._node is None:
            raise RuntimeError("call SystemManager.instance().init(name) first")
        return self._node

    def further_node(self, node: AsyncNodeHandle) -> tuple[BackgroundLoop, Executor]:
        """Start another node of this process (called by `NodeHandle`)."""
        self._checked_node()
        loop = self._started_loop()
        loop.run(node.start())
        return loop, self._executor

    def parts(self) -> tuple[BackgroundLoop, Executor, AsyncNodeHandle]:
        """What the process's own node is made of (called by `NodeHandle`)."""
        return self._started_loop(), self._executor, self._checked_node()

    def adopt(self, node: BlockingNode) -> None:
        """Close a further node at `shutdown` (called by `NodeHandle`)."""
        self._nodes.append(node)


class NodeHandle(BlockingNode):
    """A blocking handle to a node.

    Args:
        name: None means the node that `SystemManager.init` started; any number of handles may share it.
            A name starts a further node in this process, spun with the first.
        options: Of a further node: ``master``, ``ip``, ``port``, ``max_message_bytes``, ``transports``,
            as of `simple_ros.aio.NodeHandle`.

    Raises:
        RuntimeError: `SystemManager.init` was not called.
    """

    def __init__(self, name: str | None = None, **options: Any) -> None:
        system = SystemManager.instance()
        if name is None:
            super().__init__(*system.parts())
            return
        node = AsyncNodeHandle(name, **options)
        loop, executor = system.further_node(node)
        super().__init__(loop, executor, node)
        system.adopt(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
