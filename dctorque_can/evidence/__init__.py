"""What a recording says of a vehicle file."""
