"""Results as tables and plots. Nothing is computed here: every number comes from the room whose result it is."""
