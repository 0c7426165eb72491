"""Reference frames and the Earth orientation behind them."""
