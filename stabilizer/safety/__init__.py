"""Which sensors are trusted, and when the stabilizer gives up in order."""
