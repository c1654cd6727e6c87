"""Signals of every tick: recorded during a run, written to a file, and read back."""
