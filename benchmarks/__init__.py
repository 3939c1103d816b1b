"""Every claim about speed, beside the peer it is measured against in the same run."""
