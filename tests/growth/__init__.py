"""Objects that move all day: what the history, the changes and the followers grow to."""
