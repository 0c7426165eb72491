"""Running of a graph: processes, progress, end states and exit codes."""
