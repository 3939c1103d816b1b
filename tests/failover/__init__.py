"""What a cluster with failover keeps, when servers are killed, cut off or stopped."""
