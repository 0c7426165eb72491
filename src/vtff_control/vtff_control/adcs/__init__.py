"""The ADCS module of a spacecraft on its CAN bus, seen from the controller: frames, link, log."""
