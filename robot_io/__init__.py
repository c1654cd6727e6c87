"""Connects robots to the bus: robot files, Zenoh session, client, server, gate."""
