"""The demo in the office, and the figures of the documentation."""
