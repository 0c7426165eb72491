"""A CAN bus of a device: opened, opened again when it fails, its parameters and its state."""
