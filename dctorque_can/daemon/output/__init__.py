"""What the service sends on the bus, and when it does not."""
