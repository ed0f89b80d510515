"""Dynamic sensor zeroing of a vehicle's 6-axis IMU over CAN."""

__version__ = "0.1.0"
