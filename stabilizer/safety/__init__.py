"""Which sensors are believed, and when to give up in order."""
