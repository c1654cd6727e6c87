"""What is said: bus messages, topic table, codec and file formats."""
