"""Integer ambiguities: least squares (LAMBDA), validation, failure rates."""
