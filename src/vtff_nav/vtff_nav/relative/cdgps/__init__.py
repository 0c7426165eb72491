"""The millimetre filter: carrier-phase differential GNSS with orbit dynamics."""
