"""Playing of a bag: message order, clock, quality of service and steps."""
