"""Print the processor time of one frame in the Kalman filter, µs: ``filter.py LOG CAR``."""

import sys
import time
from pathlib import Path

import names

log, car = Path(sys.argv[1]), sys.argv[2]
config = names.kalman_config(car)
frames = names.frames_of(log)
samples = names.decoded(config, frames)
took = []
for _ in range(5):
    feed = names.new_feed(config)
    start = time.thread_time()
    feed(samples)
    took.append(time.thread_time() - start)
print(1e6 * min(took) / len(frames))
