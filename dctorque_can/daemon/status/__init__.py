"""What the service tells of itself: while it runs, and at its end."""
