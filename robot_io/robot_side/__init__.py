"""What a robot runs: server, command gate, mode machine, driver."""
