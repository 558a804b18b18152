"""Print the processor time of the service over that of receiving and cantools alone: ``service.py LOG CAR``.

Both take the same messages from a virtual bus of python-can, 4000 a second, in a thread of their own whose
processor time is measured. The loop decodes the messages that inputs come from, and does nothing else.
"""

import sys
import threading
import time
from pathlib import Path

import can
import names

RATE = 4000
SECONDS = 5.0
BURST = 8  # messages at once, every 2 ms

log, car = Path(sys.argv[1]), sys.argv[2]
config = names.kalman_config(car)
known = names.mapped_messages(config)
messages = names.messages_of(log, round(RATE * SECONDS))


def connect() -> can.BusABC:
    return can.Bus(interface="virtual", channel="bench", preserve_timestamps=True)


def send() -> None:
    with connect() as bus:
        start = time.perf_counter()
        for first in range(0, len(messages), BURST):
            time.sleep(max(0.0, start + first / RATE - time.perf_counter()))
            for message in messages[first : first + BURST]:
                bus.send(message)


def processor_time(work, stop) -> float:
    """Return the seconds that ``work`` takes in its thread while all messages are sent."""
    took = []

    def measured() -> None:
        start = time.thread_time()
        work()
        took.append(time.thread_time() - start)

    thread = threading.Thread(target=measured)
    thread.start()
    time.sleep(0.2)
    send()
    time.sleep(0.2)
    stop()
    thread.join()
    return took[0]


service = names.new_service(config, connect)
of_service = processor_time(service.run, service.stop)

over = threading.Event()
received = []
with connect() as bus:

    def loop() -> None:
        while not over.is_set():
            message = bus.recv(0.1)
            if message is None:
                continue
            received.append(message.arbitration_id)
            if message.arbitration_id in known:
                known[message.arbitration_id].decode(message.data, decode_choices=False)

    of_loop = processor_time(loop, over.set)
if len(received) != len(messages):
    sys.exit(f"{len(received)} of {len(messages)} messages received")
print(of_service / of_loop)
