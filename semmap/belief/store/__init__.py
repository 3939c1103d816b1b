"""Database access of beliefs: observations, inferences from them, teachings."""
