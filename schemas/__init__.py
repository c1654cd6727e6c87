"""What processes and files say: bus messages, topic table, codec, file formats."""
