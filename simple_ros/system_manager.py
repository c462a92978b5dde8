"""SystemManager and the blocking NodeHandle: the seed's own API, in Python spelling.

::

    from simple_ros import NodeHandle, SystemManager
    from simple_ros.msg.std_msgs import String

    system = SystemManager.instance()
    system.init("listener")
    NodeHandle().subscribe("chatter", String, lambda message: print(message.data))
    system.spin()

`NodeHandle("listener")` alone does what the first two lines do, and has a `spin` of its own.
"""

from __future__ import annotations

import atexit
import os
import threading
import time
from typing import Any, Self

from simple_ros.arguments import Arguments
from simple_ros.blocking import BlockingNode
from simple_ros.blocking.process import ProcessHooks
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
        self._hooks = ProcessHooks(self._interrupt)

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
        namespace: str = "",
        arguments: Arguments | None = None,
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
            namespace: Where its relative names are; ``__ns:=`` replaces it.
            arguments: Name, namespace, remaps and parameters from outside; None takes those of the
                process, from ``SIMPLE_ROS_ARGS`` and the command line.

        Raises:
            RuntimeError: It was called before, with no `shutdown` in between.
            InvalidName: The name breaks the rules.
            BadArgument: A word of the command line makes no sense.
            BadParameterText: A file of parameters is wrong.
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
                # It would take the interpreter from the user's own thread.
                busy_poll=False,
                namespace=namespace,
                arguments=arguments,
            )
            self._begin(node)

    def _begin(self, node: AsyncNodeHandle) -> None:
        """Start the process's own node."""
        if self._executor.is_stopped:
            self._executor = Executor()
        loop = self._started_loop()
        loop.run(node.start())
        loop.start(self._await_end(node))
        self._node = node
        self._hooks.take()
        atexit.register(self._at_exit)

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
        self._hooks.hold()
        try:
            for other in nodes:
                BlockingNode.close(other)
            if node is not None:
                loop.run(node.close())
            loop.stop()
        finally:
            atexit.unregister(self._at_exit)
            self._hooks.give_back()

    def _at_exit(self) -> None:
        self._hooks.give_up()
        self.shutdown()

    def _interrupt(self) -> bool:
        """A signal has come: ends the spin, if it interrupted one."""
        spins = self._spinning == threading.get_ident()
        if spins:
            self._executor.stop()
        return spins

    @property
    def is_running(self) -> bool:
        """Whether it is between `init` and its end."""
        return self._node is not None and not self._executor.is_stopped

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
            raise RuntimeError(
                "no node was started: NodeHandle(name) or SystemManager.init(name) does"
            )
        return self._node

    def start_node(self, node: AsyncNodeHandle) -> tuple[BackgroundLoop, Executor]:
        """Start a node (called by `NodeHandle`): the process's own, or a further one if that runs."""
        with self._lock:
            if self._node is not None and self._node.is_closed:
                self.shutdown()
            if self._node is None:
                self._begin(node)
            else:
                self._started_loop().run(node.start())
            return self._started_loop(), self._executor

    def runs_on(self, loop: BackgroundLoop) -> bool:
        """Whether that loop is the one that runs now (called by `NodeHandle`)."""
        return self._loop is loop

    def parts(self) -> tuple[BackgroundLoop, Executor, AsyncNodeHandle]:
        """What the process's own node is made of (called by `NodeHandle`)."""
        return self._started_loop(), self._executor, self._checked_node()

    def adopt(self, node: BlockingNode) -> None:
        """Close a node at `shutdown` (called by `NodeHandle`)."""
        self._nodes.append(node)


class NodeHandle(BlockingNode):
    """A blocking handle to a node.

    ::

        node = NodeHandle("listener")
        node.subscribe("chatter", String, lambda message: print(message.data))
        node.spin()

    Args:
        name: The first one given in a process is the name of its own node, as with `SystemManager.init`;
            each one after that starts a further node, spun with the first. None means the process's
            own node, which was started before; any number of handles may share it.
        options: Of a node that is started: ``master``, ``ip``, ``port``, ``max_message_bytes``,
            ``transports``, ``namespace``, ``arguments``, as of `simple_ros.aio.NodeHandle`.

    Raises:
        RuntimeError: No name is given, and nothing was started before.
        InvalidName: The name breaks the rules.
        AddressInUse: The port is taken.
    """

    def __init__(self, name: str | None = None, **options: Any) -> None:
        system = SystemManager.instance()
        if name is None:
            super().__init__(*system.parts())
            return
        node = AsyncNodeHandle(name, **options)
        super().__init__(*system.start_node(node), node)
        system.adopt(self)

    def spin(self, threads: int = 1) -> None:
        """Run the callbacks and timers of all nodes of the process; see `SystemManager.spin`.

        Args:
            threads: How many threads run them; see `CallbackGroup`.

        Raises:
            NodeNameTaken: A newer node runs under the name of the process's own node.
        """
        SystemManager.instance().spin(threads)

    def close(self) -> None:
        """Send what still waits, say goodbye to the Master, end everything.

        Closing the process's own node ends every spin. Twice does nothing more.
        """
        if SystemManager.instance().runs_on(self._loop):
            super().close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
