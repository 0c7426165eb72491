"""One way into every observation file, whatever its format."""
