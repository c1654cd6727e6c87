"""Checks of this machine: whether a run can work here, and how well."""
