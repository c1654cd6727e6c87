"""Security of the bus: certificates, access control, locator checks."""
