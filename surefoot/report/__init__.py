"""Offline pages about runs."""
