"""Signals of every tick: taken in while a run goes, written, and read back."""
