"""Route graphs of Nav2."""
