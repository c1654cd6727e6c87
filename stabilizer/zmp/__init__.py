"""The ZMP baseline: DCM feedback, wrench distribution, foot admittance."""
