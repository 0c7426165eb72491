"""CAN buses from the controller's side: opening, losing, opening again; checksums, DBC files."""
