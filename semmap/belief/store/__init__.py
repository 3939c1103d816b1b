"""Database access of beliefs: observations, what is inferred from them, what people teach."""
