"""Bus records: MCAP files written, read and exported."""
