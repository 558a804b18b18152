"""What is plausible whichever estimator is chosen: the numbers a user may meet.

Those that depend on the car are keys of the vehicle file; these hold for any.
"""

IMPLAUSIBLE_RATIO = 0.15
"""By which share a shaft's speed may differ from wheels and gear before both do not fit each other (Status
SPEED_IMPLAUSIBLE): neighbouring gears are further apart."""
IMPLAUSIBLE_TIME_US = 300_000
"""… for how long, before it is said: a synchroniser is done by then."""
PLAUSIBLE_WHEEL_SPEED = 5.0
"""rad/s; slower wheels are too coarse to be compared with a shaft."""
CAPACITY_MARGIN = 1.5
"""An estimate beyond this multiple of a clutch's static capacity is limited and marked (Status LIMITED)."""
WIDEST = 1e6
"""No input of any kind can be larger: rad/s, N·m, …"""
TIE_UP_NM = 20.0
"""What must recirculate to be a tie-up: a tenth of an engine's torque; in gears 1 and 2 it brakes a 1600 kg car by
0.25 m/s². Less than the standard deviations within a shift (10 to 25 N·m) would be suspected in every one."""
MOST_POWER_W = 1e7
"""No clutch survives a tenth of it; energies stay finite whatever the inputs say."""
HELD_US = 1_000_000
"""For so long a shaft whose clutch is told to be closed may turn as no gear, or another one, lets it: no sleeve
moves under torque, and the driveline has rung itself out by then."""
INTERVALS_LEARNED_FROM = 64
"""A timeout that is learned stands on so many intervals. Then it stays: a bus that loses more and more frames does
not move it."""
ENOUGH_INTERVALS = 8
"""… and counts from so many on."""
FIRST_TIMEOUT_US = 100_000
"""… and is this until then."""
TIMEOUT_INTERVALS = 5
"""… and is so many usual intervals: four frames in a row may be lost."""
SHORTEST_TIMEOUT_US = 20_000
"""… and never shorter, nor longer than `samples.LONGEST_LEARNED_US`."""
