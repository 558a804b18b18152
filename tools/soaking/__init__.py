"""The rooms of ``tools/soak``: a bus, the service on it, what is done to both, and what must hold."""
