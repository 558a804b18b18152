"""What decides whether an estimate is valid, a sensor at fault, an input still good: the numbers a user may meet.

Those that depend on the car are keys of ``estimator.kalman`` in the vehicle file; these hold for any.
"""

# --- validity of an estimate (Status) ---
VALID_SHARE = 0.1
"""Of its plausibility limit (1.5 times the static capacity) that a valid clutch torque's standard deviation may
be: with more, its sign is in doubt at the torques of ordinary driving."""
VALID_OUTPUT_SHARE = 0.02
"""… and the output torque's and the road load's; the output limit holds both clutches at once in first gear, ten
times what is driven with."""
SETTLING_US = 250_000
"""From a start until an estimate counts as converged: a dozen frames of each sensor on a slow bus (20 ms)."""

# --- inputs that are missing ---
BRIDGED_US = 500_000
"""For so long the model stands in for an input that is missing: what a gearbox does in a shift takes as long."""

# --- what was learned of the speeds ---
PLAINLY = 4.0
"""Standard deviations that the vehicle file allows, by which a ratio or the delay of the wheels is plainly another
one: that still holds when the filter starts anew."""

# --- sensors at fault (Status, `faults.SensorFault`) ---
FASTEST_WHEEL = 200.0
"""rad/s² that the driven wheels can have: on ice, or locked by brakes."""
MOVED = 4.0
"""Standard deviations by which a prediction must leave a value that is repeated, for its sensor to be stuck."""
CHANCE = 1e-6
"""… or the probability that a sound one repeats itself so often."""
LARGEST_JUMP = 0.2
"""rad/s between two wheels of an axle from sample to sample, in a change of lane."""
LARGEST_SPREAD = 0.15
"""Of the speed, between two wheels of an axle, in the narrowest bend."""
SAME_TIME_US = 25_000
"""Apart, two wheels of an axle that come in messages of their own can still be compared."""
TOO_MANY = 3
"""Sensors beyond the gate at once are not at fault, but the model."""
MOTION = 3
"""Measurements beyond the gate that must lie on one line to be a motion."""
IMPLAUSIBLE_TORQUE = 4.0
"""Standard deviations of the nominal engine torque's error, beyond which it is biased."""
JUMP = 60.0
"""N·m from one nominal engine torque to the next that the one after must confirm, …"""
FASTEST_TORQUE = 2000.0
"""… and N·m/s for the time between: a petrol engine with its throttle torn open."""

FIRES = 40.0
"""rad/s below which no engine fires: half of the slowest idle. What is told of its torque then counts no more."""

# --- tyres that slip ---
ROLLS_SHARE = 0.06
"""Of the speed, by which driven wheels that roll leave the body at most, tight bends apart, …"""
ROLLS = 0.6
"""… and rad/s."""

SPINS = 1000.0
"""N·m/√s by which the tyres' torque may change, from which on they count as slipping: a locked clutch is shaken,
and driven wheels differ by their slip."""

# --- driven wheels in place of undriven ones ---
SLIP_VARIANCE = 0.25
"""(rad/s)², of driven wheels against the body, where no wheel rolls with it."""
