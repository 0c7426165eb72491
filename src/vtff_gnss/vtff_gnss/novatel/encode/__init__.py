"""NovAtel logs written as an emulated receiver sends them."""
