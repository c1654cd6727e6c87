"""Checks that any robot behind the bus must pass, tried on a live one."""
