"""The live service: the only room with a wall clock, threads, processes and signals."""
