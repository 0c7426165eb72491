"""Survey of irregular plasma: crossings of walls, their drift, next crossings, relative orbits."""
