"""Writing RINEX files: header, navigation and observation records."""
