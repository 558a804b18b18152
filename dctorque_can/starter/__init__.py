"""What a DBC and a recorded drive say of a car: proposals for a new vehicle file."""
