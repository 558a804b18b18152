"""CAN frames to samples and estimates to CAN frames, by DBC, with end-to-end protection."""
