"""Certificates, access control, locator checks."""
