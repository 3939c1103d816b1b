"""Database access of missions: steps, the connection that holds locks, what robots tell."""
