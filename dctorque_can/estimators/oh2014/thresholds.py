"""What decides whether an estimate of the 2014 observer is valid: the numbers a user may meet beside its design.

Those that depend on the car are keys of ``estimator.oh2014`` in the vehicle file; these hold for any.
"""

SETTLING = 5.0
"""Time constants of the slowest part before an estimate counts as converged: 0.7 % of the start is left."""
ROAD_LOAD_MEMORY_US = 5_000_000
"""For so long a pause the learned road load still holds: a road's grade does not change faster."""
MAX_WHEEL_ACCELERATION = 100.0
"""rad/s², far beyond any tyre."""
MAX_TAU_E = 0.5
"""N·m·s/rad; 100 N·m of engine torque error at the reference speed."""
MAX_TAU_O = 3.0
"""Times J_v; no load makes a car that heavy."""
