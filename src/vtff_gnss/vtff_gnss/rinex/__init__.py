"""RINEX 2, 3 and 4 observation and navigation files: readers; writers in write."""
