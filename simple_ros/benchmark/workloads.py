"""What is measured: how many messages of which kind, and how fast."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

__all__ = ["MIB_BYTES", "WORKLOADS", "Job", "Role", "Workload", "job_from"]

Role = Literal["send", "receive"]
MIB_BYTES = 1024 * 1024
_FULL_HD_BYTES = 1920 * 1080 * 3


@dataclass(frozen=True, slots=True)
class Workload:
    """One kind of traffic.

    Attributes:
        name: What it is called.
        title: What it is, in words.
        shape: Twist: 58 bytes of protobuf. Image: a few numbers and ``size_bytes`` of pixels.
        count: Messages.
        rate_hz: How many a second; 0 sends as fast as the receivers take them.
        size_bytes: Of the pixels.
        receivers: Processes that receive.
        measure: The figure that matters: a key of the summary.
        unit: Of that figure.
    """

    name: str
    title: str
    shape: Literal["twist", "image"]
    count: int
    rate_hz: float = 0.0
    size_bytes: int = 0
    receivers: int = 1
    measure: str = "per_second"
    unit: str = "msg/s"

    @property
    def is_better_larger(self) -> bool:
        """Whether more of the figure is better: true of rates, false of times."""
        return not self.measure.endswith(("_us", "_ms"))

    def shortened(self, fraction: float) -> Workload:
        """The same with fewer messages, but at least ten."""
        return replace(self, count=max(10, round(self.count * fraction)))


WORKLOADS = {
    workload.name: workload
    for workload in (
        Workload(
            "latency",
            "one-way latency at 1 kHz",
            "twist",
            1500,
            1000.0,
            measure="p50_us",
            unit="us",
        ),
        Workload("small", "small messages flat out", "twist", 200_000),
        Workload(
            "mib", "1 MiB flat out", "image", 300, size_bytes=MIB_BYTES, measure="mb_s", unit="MB/s"
        ),
        Workload(
            "mib30",
            "1 MiB at 30 Hz",
            "image",
            45,
            30.0,
            MIB_BYTES,
            measure="p50_ms",
            unit="ms",
        ),
        Workload(
            "image30",
            "6.2 MB (1080p) at 30 Hz",
            "image",
            45,
            30.0,
            _FULL_HD_BYTES,
            measure="p50_ms",
            unit="ms",
        ),
        Workload("fanout", "small messages to 8 processes, in sum", "twist", 100_000, receivers=8),
    )
}


@dataclass(frozen=True, slots=True)
class Job:
    """What one process of a run is told.

    Attributes:
        role: What it does.
        workload: With what.
        index: Which of the receivers.
        at: What the receivers said when they were ready; for the sender.
        services: Where what the peer needs is: ``master``, say, to an address.
        options: Of the peer: ``transport``, ``loop`` and the like.
    """

    role: Role
    workload: Workload
    index: int = 0
    at: tuple[Any, ...] = ()
    services: dict[str, str] = field(default_factory=dict)
    options: dict[str, str] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """For `job_from`, in another process."""
        return asdict(self)


def job_from(fields: dict[str, Any]) -> Job:
    """The job that `Job.as_json` described."""
    return Job(**fields | {"workload": Workload(**fields["workload"]), "at": tuple(fields["at"])})
