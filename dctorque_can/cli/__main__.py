"""``python -m dctorque_can.cli`` is ``dctorque``."""

from dctorque_can.cli.main import main

main()
