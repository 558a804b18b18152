"""Print the median time from a received message to its estimate, µs: ``live.py LOG CAR``."""

import statistics
import sys
import time
from pathlib import Path

import names

MOST = 20_000

log, car = Path(sys.argv[1]), sys.argv[2]
feed = names.new_live_feed(names.kalman_config(car))
took = []
for message in names.messages_of(log, MOST):
    start = time.perf_counter()
    feed(message)
    took.append(time.perf_counter() - start)
print(1e6 * statistics.median(took[len(took) // 10 :]))
