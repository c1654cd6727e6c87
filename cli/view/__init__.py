"""The live page and the scene it shares with reports."""
