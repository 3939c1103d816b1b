"""Database access of manipulation: models, devices, actions, their outcomes, and bundles."""
