"""Zenoh: sessions, channels, waits and typed inboxes."""
