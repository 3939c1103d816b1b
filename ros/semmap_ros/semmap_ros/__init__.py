"""A node of ROS 2 that publishes a map of semmap and answers questions on it."""
