"""The topology for others' stacks: route graphs of Nav2 and Open-RMF, DOT, pictures, JSON."""
