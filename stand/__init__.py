"""The virtual IMU test stand: procedures, motion, physics, sensors, recordings."""

__version__ = "0.2.0"
