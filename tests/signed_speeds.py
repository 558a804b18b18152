"""A vehicle file whose speeds have a sign, so that the direction of a short launch is not in doubt."""

SPEEDS = ("shaft1_speed", "shaft2_speed", *(f"wheel_speeds.{wheel}" for wheel in ("fl", "fr", "rl", "rr")))
OVERRIDES = {f"inputs.{speed}.signed": "true" for speed in SPEEDS}
OPTIONS = [part for key, value in OVERRIDES.items() for part in ("--set", f"{key}={value}")]
