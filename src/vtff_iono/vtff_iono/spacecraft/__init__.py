"""The ionosphere chain of one spacecraft, and the second that a formation hands to it."""
