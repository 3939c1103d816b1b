"""Random buildings that nothing is tuned for, and oracles that judge what a map says of them."""
