"""The store: rows a second through the HTTP face's parser and SQLite, and the time of a last-value query.

`python benchmarks/wireless/store.py [--seeds 20]` (a seed is one run of 40 000 rows of 40 fields)
"""

from __future__ import annotations

import random
import tempfile
import time
from pathlib import Path
from statistics import quantiles

from common import Column, arguments, print_parameters, print_table

from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.flux import parse_flux
from simple_ros_engines.store.server import StoreServer

ROWS, LINKS, FIELDS, BATCH = 40_000, 100, 40, 100


def lines(seed: int, start_ns: int) -> list[str]:
    draw = random.Random(seed)
    body = ",".join(f"field_{index}={draw.random():.4f}" for index in range(FIELDS))
    rows = [
        f"ue,rnti={0x4601 + row % LINKS:04x} {body} {start_ns + row // LINKS * 10_000_000}"
        for row in range(ROWS)
    ]
    return ["\n".join(rows[at : at + BATCH]) for at in range(0, ROWS, BATCH)]


def one_seed(seed: int) -> list[float]:
    with tempfile.TemporaryDirectory() as folder:
        store = MetricsStore(Path(folder, "metrics.db"))
        server = StoreServer(store)
        batches = lines(seed, time.time_ns() - 10**10)
        begun = time.perf_counter()
        for batch in batches:
            server.take(batch)
        took = time.perf_counter() - begun
        times = []
        for index in range(500):
            text = (
                'from(bucket: "b") |> range(start: -1m) |> filter(fn: (r) => r._measurement == "ue"'
                f' and r.rnti == "{0x4601 + index % LINKS:04x}") |> last()'
            )
            begun = time.perf_counter()
            found = store.last(parse_flux(text, time.time_ns()))
            times.append(1000 * (time.perf_counter() - begun))
            assert len(found) == FIELDS
        store.close()
    return [ROWS / took, quantiles(times, n=2)[0], quantiles(times, n=100)[98]]


COLUMNS = [
    Column("rows a second", "", min, "bar: >= 20000"),
    Column("last-value query, median", "ms", max, "bar: < 1"),
    Column("last-value query, p99", "ms", max),
]


def main() -> None:
    options = arguments(__doc__ or "")
    print_parameters("store", rows=ROWS, links=LINKS, fields=FIELDS, rows_in_a_batch=BATCH)
    rows = [one_seed(seed) for seed in range(1, options.seeds + 1)]
    print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
