"""How it is said: robot files, Zenoh session, client, server and command gate."""
