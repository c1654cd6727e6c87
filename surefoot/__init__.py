"""Surefoot: force-feedback whole-body stabilizer for position-controlled humanoids."""
