"""What the soak found, bar by bar; kept as JSON, so that it can be judged again."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from soak_model import Fault, Life, Sample, Struck, judge_events, lives

from simple_ros_hub.journal import Entry

BAR_S = 5.0


@dataclass
class Found:
    """All that a run left.

    Attributes:
        minutes: How long it was to be.
        struck: The faults.
        samples: Memory and open files, by name and process.
        entries: The event log, over all hubs.
        topic: Numbers of the events that came on the topic, in order.
        more: What else is wrong.
    """

    minutes: float
    struck: list[Struck]
    samples: Mapping[tuple[str, int], Sequence[Sample]]
    entries: list[Entry]
    topic: list[int] = field(default_factory=list)
    more: list[str] = field(default_factory=list)

    def save(self, file: Path) -> None:
        """As JSON."""
        whole = {
            "minutes": self.minutes,
            "struck": [asdict(item) for item in self.struck],
            "samples": [
                [name, pid, [[round(s.at_s, 1), s.rss_bytes, s.files] for s in taken]]
                for (name, pid), taken in self.samples.items()
            ],
            "events": [
                [e.number, e.stamp_ns, e.component, e.text, e.is_error] for e in self.entries
            ],
            "topic": self.topic,
            "more": self.more,
        }
        file.write_text(json.dumps(whole))

    @classmethod
    def read(cls, file: Path) -> Found:
        """From JSON."""
        whole: dict[str, Any] = json.loads(file.read_text())
        struck = [Struck(**{**item, "fault": Fault(**item["fault"])}) for item in whole["struck"]]
        samples = {(n, pid): [Sample(*s) for s in taken] for n, pid, taken in whole["samples"]}
        last = max((s.at_s for taken in samples.values() for s in taken), default=0.0)
        return cls(
            whole.get("minutes", last / 60),
            struck,
            samples,
            [Entry(*values) for values in whole["events"]],
            whole.get("topic", []),
            whole.get("more", []),
        )

    def tell(self) -> bool:
        """Print; whether every bar is met."""
        events = judge_events(self.entries, self.struck)
        long = lives(self.samples, 60 * self.minutes / 4, min(300.0, 6 * self.minutes))
        self._tell_times()
        _tell_lives(long)
        told = Counter(self.topic)
        numbers = {entry.number for entry in self.entries}
        print(
            f"events: {len(self.entries)} in the log, {sum(e.is_error for e in self.entries)} of them "
            f"errors; on the topic {sum(count > 1 for count in told.values())} came twice, "
            f"{len(numbers - told.keys()) if told else '?'} did not come"
        )
        wrong = [
            f"{number} {item.fault.kind} {item.fault.victim}: {text}"
            for number, item in enumerate(self.struck)
            for text in item.wrong
        ]
        late = [text for text in wrong if "took" in text or "not within" in text]
        bars = {
            "lost or changed processes": [text for text in wrong if text not in late],
            f"not well within {BAR_S:g} s": late,
            "not in the log exactly once": events.wrong,
            # This program keeps all it has seen.
            "memory or files that rise": [
                life.name for life in long if not life.is_flat and life.name != "this program"
            ],
            "errors no fault explains": events.unexplained,
            "else": self.more,
        }
        for title, lines in bars.items():
            print(f"{title}: {len(lines)}", *lines, sep="\n   ")
        del bars["errors no fault explains"]
        return not any(bars.values())

    def _tell_times(self) -> None:
        print(f"\n{len(self.struck)} faults in {self.minutes:.0f} minutes; well again after")
        for kind in dict.fromkeys(item.fault.kind for item in self.struck):
            times = [item.took_s for item in self.struck if item.fault.kind == kind]
            print(
                f"   {kind:<17} {len(times):4d}   median {median(times):5.2f} s, worst {max(times):5.2f} s"
            )


def _tell_lives(long: list[Life]) -> None:
    print("memory and open files of those that lived long")
    for life in sorted(long, key=lambda life: (life.name, -life.minutes)):
        print(
            f"   {life.name:<25} {life.minutes:5.1f} min  {life.mb:6.1f} MB  "
            f"slope {life.slope_mb_h:+6.2f} MB/h  last quarter {100 * life.grown:+5.2f} % "
            f"({life.grown_mb:+.2f} MB)  files {life.files[0]:g} -> {life.files[1]:g}  "
            f"{'flat' if life.is_flat else 'RISES'}"
        )
